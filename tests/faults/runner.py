"""One damaged case in a process of its own: what it did, in how long and with how much memory."""

import contextlib
import hashlib
import json
import os
import re
import resource
import select
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SECONDS = 10
"""A case that takes longer hangs."""
MEMORY = 2 << 30
"""A case that needs more is a fault [bytes]."""
CLASSES = ("fine", "said", "refused", "silent", "traceback", "crash", "hang", "memory")
"""fine: the result is right; said: another result, and a word about it; refused: exit 2 (or 1) and a sentence; silent: another
result and no word."""
FAULTS = CLASSES[3:]
_WORD = re.compile(
    r"warning|note:|skipp|lost|left out|not used|damaged|without|cannot|no .* found|missing|ignored",
    re.IGNORECASE,
)
_ODD = re.compile(r"(?<![\w.])-?(?:nan|inf(?:inity)?)(?![\w.])", re.IGNORECASE)
_TIMING = ("seconds", "wall", "fps", "_ms", "stages", "rss", "speed", "command", "took")


@dataclass(frozen=True)
class Outcome:
    """What a case did."""

    kind: str
    """One of `CLASSES`."""
    code: int
    out: str
    err: str
    seconds: float
    memory: int
    result: str

    @property
    def place(self) -> str:
        """Where it failed: the last line of our own code in the traceback and the error."""
        last = [line for line in self.err.splitlines() if line.strip()][-1:] or [""]
        ours = re.findall(
            r'File "[^"]*/(?:src/dsmap|fuzz|kernels|fusion|dsnet|sim_scenes|tools)/([^"]+)", line (\d+)',
            self.err,
        )
        return f"{':'.join(ours[-1]) if ours else ''} {last[0][:160]}"


def call(
    action: Callable[[], int],
    out: Path,
    base: str | None = None,
    base_words: frozenset[str] = frozenset(),
    must_tell: bool = False,
) -> Outcome:
    """Run `action` in a forked child that may take 10 s and 2 GB.

    Args:
        out: folder whose content, with what is printed, is the result.
        base: the result of the whole input; None: this is the whole input.
        base_words: lines with warnings that the whole input has, too.
        must_tell: whether another result without a word is a fault.
    """
    logs = [out.parent / "stdout.txt", out.parent / "stderr.txt"]
    pid = os.fork()
    if pid == 0:
        _child(action, logs)
    ready = _ends(pid)
    if not ready:
        os.kill(pid, signal.SIGKILL)
    _, status, usage = os.wait4(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    said, err = (log.read_text(errors="replace") for log in logs)
    memory = usage.ru_maxrss * 1024
    result = result_of(out, said) if code == 0 else ""
    kind = _kind(ready, code, said, err, memory, result, base, base_words, must_tell)
    return Outcome(kind, code, said, err, usage.ru_utime + usage.ru_stime, memory, result)


def _ends(pid: int) -> bool:
    """Wait for a child; False if it uses `SECONDS` of processor time, or sleeps for as long."""
    watch = os.pidfd_open(pid)
    try:
        used, idle = 0.0, 0.0
        while not select.select([watch], [], [], 1.0)[0]:
            now, runs = _processor_time(pid)
            idle = 0.0 if runs or now > used else idle + 1.0
            used = now
            if used > SECONDS or idle > SECONDS:  # a busy machine is no fault of the case
                return False
        return True
    finally:
        os.close(watch)


def _processor_time(pid: int) -> tuple[float, bool]:
    """Seconds that a process has used, and whether it wants more."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK"), words[0] in "RD"


def _child(action: Callable[[], int], logs: list[Path]) -> None:
    code = 70
    try:
        for number, log in zip((1, 2), logs, strict=True):
            os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.stdout, sys.stderr = (os.fdopen(os.dup(n), "w") for n in (1, 2))  # whatever pytest made of them
        now = _data_bytes()
        resource.setrlimit(resource.RLIMIT_DATA, (now + (3 << 30), now + (3 << 30)))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 30, 1 << 30))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        code = int(action() or 0)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code & 0xFF)


def _data_bytes() -> int:
    text = Path("/proc/self/status").read_text()
    found = re.search(r"VmData:\s+(\d+) kB", text)
    return int(found[1]) * 1024 if found else 0


def _kind(
    in_time: bool,
    code: int,
    said: str,
    err: str,
    memory: int,
    result: str,
    base: str | None,
    base_words: frozenset[str],
    must_tell: bool,
) -> str:
    if not in_time:
        return "hang"
    if memory > MEMORY:
        return "memory"
    if (
        "Traceback (most recent call last)" in err
        or "Traceback (most recent call last)" in said
        or code == 70
    ):
        return "traceback"
    if code < 0 or code > 128:
        return "crash"
    if code != 0:
        return "refused" if err.strip() else "traceback"
    if base is None or result == base:
        return "fine"
    if words(said, err) - base_words:
        return "said"
    odd = len(_ODD.findall(result)) > len(_ODD.findall(base))
    return "silent" if must_tell or odd else "fine"


def words(said: str, err: str) -> frozenset[str]:
    """Lines that warn, without their numbers."""
    return frozenset(
        re.sub(r"\d+", "#", line) for line in (said + "\n" + err).splitlines() if _WORD.search(line)
    )


def result_of(out: Path, said: str) -> str:
    """What a command printed and wrote, without times: text as it is, all else as a hash."""
    parts = []
    for path in sorted(out.rglob("*")) if out.exists() else ():
        if not path.is_file():
            continue
        name = path.relative_to(out).as_posix()
        if path.name.startswith(
            ("stats.json", "config.yaml", "log", "checkpoint", "history", "model-card", "card.md")
        ):
            continue
        if path.suffix == ".json":
            parts.append(f"{name} {json.dumps(_timeless(json.loads(path.read_text())))}")
        elif path.suffix == ".txt" and path.stat().st_size < 1 << 20:
            parts.append(f"{name} {path.read_text()}")
        elif path.suffix == ".safetensors":
            from safetensors.numpy import load_file

            arrays = load_file(path)
            digest = hashlib.sha256(
                b"".join(n.encode() + a.tobytes() for n, a in sorted(arrays.items()))
            ).hexdigest()
            odd = sum(int((a != a).sum()) for a in arrays.values() if a.dtype.kind == "f")
            parts.append(f"{name} {digest} {'nan ' * min(odd, 5)}")
        elif path.suffix == ".ply":
            parts.append(f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()} {_odd_vertices(path)}")
        else:
            parts.append(f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()}")
    lines = [line for line in said.splitlines() if not re.search(r"MiB|frames/s|written|step ", line)]
    return "\n".join([*parts, *lines])


def _odd_vertices(path: Path) -> str:
    """`nan` where positions of a map of ours are not numbers."""
    from dsmap.errors import InputError
    from dsmap.fusion.exports.ply import read_ply

    try:
        table = read_ply(path)
        names = [n for n in ("x", "y", "z", "radius", "confidence") if n in (table.dtype.names or ())]
        return "nan" if any((table[n] != table[n]).any() for n in names) else ""
    except InputError:
        return ""


def _timeless(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {k: _timeless(v) for k, v in tree.items() if not any(word in k for word in _TIMING)}
    return [_timeless(v) for v in tree] if isinstance(tree, list) else tree
