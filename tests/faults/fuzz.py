"""`python tests/faults/fuzz.py --cases 1000 --seed 0`: damage inputs, call the commands that read them, count what happens.

Damage, subjects and order follow from the seed; case K of seed S is `--seed S --only K`.
"""

import argparse
import collections
import contextlib
import importlib
import io
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
for place in (HERE, HERE.parent / "helpers", HERE.parent):
    if str(place) not in sys.path:
        sys.path.insert(0, str(place))
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "DSMAP_THREADS"):
    os.environ.setdefault(name, "1")

import damage  # noqa: E402
import runner  # noqa: E402
import subjects  # noqa: E402
from command_line import cli, expand  # noqa: E402


@dataclass(frozen=True)
class Case:
    """A damaged input and what came of it."""

    number: int
    subject: str
    call: str
    damaged: str
    """Kind of damage and file."""
    outcome: runner.Outcome

    @property
    def is_fault(self) -> bool:
        return self.outcome.kind in runner.FAULTS


class Fuzzer:
    """Subjects on disk, each with what its commands do when nothing is damaged."""

    def __init__(self, folder: Path, only: str = "*"):
        """Write what is to be damaged into a folder; `only` chooses subjects by name, joined by commas."""
        self.folder = folder
        self.chosen = [s for s in subjects.SUBJECTS if any(fnmatch(s.name, o) for o in only.split(","))]
        self._prepared: dict[str, subjects.Prepared] = {}
        self._whole: dict[str, tuple[str, frozenset[str]]] = {}
        self._known = folder / "whole.json"
        if self._known.exists():
            stored = json.loads(self._known.read_text())
            self._whole = {key: (result, frozenset(words)) for key, (result, words) in stored.items()}
        import_commands(self.chosen)
        self._warm: set[str] = set()

    def run(self, seed: int, number: int) -> Case:
        """One case: the same for the same seed and number."""
        rng = np.random.default_rng((seed, number))
        shares = np.array([s.weight for s in self.chosen])
        subject = self.chosen[int(rng.choice(len(self.chosen), p=shares / shares.sum()))]
        prepared = self._prepare(subject)
        call = subject.calls[int(rng.integers(len(subject.calls)))]
        try:
            base, words = self._unharmed(subject, call)
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return Case(
                number, subject.name, call, "nothing", runner.Outcome("fine", 0, "", str(error), 0.0, 0, "")
            )
        inside, out = self._fresh(subject)
        target = prepared.files[int(rng.integers(len(prepared.files)))]
        kinds = [damage.damage(rng, inside / target, prepared.special[target])]
        while rng.random() < 0.15 and (inside / target).is_file():
            kinds.append(damage.damage(rng, inside / target, []))
        looks_closely = call.split()[0] not in (
            "info",
            "cut",
        )  # a few images are decoded; images are copied as they are
        sealed = any(fnmatch(target.name, pattern) for pattern in subject.sealed)
        must_tell = sealed and looks_closely and kinds[-1] not in ("other_image", "crowd", "another_file")
        outcome = runner.call(lambda: cli(expand(call, inside, out)), out, base, words, must_tell)
        return Case(number, subject.name, call, f"{'+'.join(kinds)} {target}", outcome)

    def check(self) -> None:
        """Every call works on its whole input."""
        for subject in self.chosen:
            self._prepare(subject)
            for call in subject.calls:
                try:
                    self._unharmed(subject, call)
                except RuntimeError as error:
                    print(error, flush=True)

    def _prepare(self, subject: subjects.Subject) -> subjects.Prepared:
        if subject.name not in self._prepared:
            self._prepared[subject.name] = subjects.prepare(subject, self.folder / "whole" / subject.name)
        return self._prepared[subject.name]

    def _unharmed(self, subject: subjects.Subject, call: str) -> tuple[str, frozenset[str]]:
        """Result and warnings of a call on the whole input, which has to work."""
        key = f"{subject.name}: {call}"
        if key not in self._whole:
            inside, out = self._fresh(subject)
            if call.split()[0] not in self._warm:  # loads kernels and more, once for all children
                self._warm.add(call.split()[0])
                with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                    cli(expand(call, inside, out))
                inside, out = self._fresh(subject)
            found = runner.call(lambda: cli(expand(call, inside, out)), out)
            if found.code != 0 or found.kind != "fine":
                raise RuntimeError(
                    f"{subject.name}: {call}: {found.kind} {found.code} on the whole input: {found.err[-2000:]}"
                )
            self._whole[key] = found.result, runner.words(found.out, found.err)
            self._known.write_text(
                json.dumps({k: (result, sorted(words)) for k, (result, words) in self._whole.items()})
            )
        return self._whole[key]

    def _fresh(self, subject: subjects.Subject) -> tuple[Path, Path]:
        """A copy of the whole input, always at the same place, and an empty folder for results."""
        case = self.folder / "case"
        shutil.rmtree(case, ignore_errors=True)
        shutil.copytree(self.folder / "whole" / subject.name, case / "in")
        (case / "out").mkdir()
        (case / "cwd").mkdir()
        os.chdir(case / "cwd")
        return case / "in", case / "out"


def import_commands(chosen: list[subjects.Subject]) -> None:
    """Import what the calls need, and leave no thread behind: children are forked."""
    import warnings

    import cv2
    import matplotlib
    from tqdm import tqdm

    from dsmap.tools.cli import COMMANDS, print_input_warnings

    matplotlib.use("Agg")
    tqdm.monitor_interval = 0
    cv2.setNumThreads(1)  # a pool would not live on in a forked child, and the child wait for it
    warnings.simplefilter("always")
    print_input_warnings()
    for command in sorted(
        {call.split()[0] for subject in chosen for call in subject.calls} & COMMANDS.keys()
    ):
        importlib.import_module(COMMANDS[command][0])
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def cases(fuzzer: Fuzzer, seed: int, numbers: range) -> Iterator[Case]:
    """The cases of these numbers, in order."""
    for number in numbers:
        yield fuzzer.run(seed, number)


def summary(found: list[Case]) -> str:
    """Counts by class, and faults by place, most frequent first."""
    counts = collections.Counter(case.outcome.kind for case in found)
    lines = [", ".join(f"{kind} {counts[kind]}" for kind in runner.CLASSES) + f" of {len(found)}"]
    places = collections.Counter((c.outcome.kind, c.subject, c.outcome.place) for c in found if c.is_fault)
    example = {(c.outcome.kind, c.subject, c.outcome.place): c for c in reversed(found) if c.is_fault}
    for key, count in places.most_common(400):
        case = example[key]
        lines.append(
            f"{count:4} {' '.join(key)}  [case {case.number}: {case.call.split()[0]} {case.damaged}]"
        )
    return "\n".join(lines)


def main() -> int:
    """Run the cases of the command line; exit code 1 if there are faults."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--subject", default="*", help="which subjects, e.g. 'scene-*,weights'")
    parser.add_argument("--only", type=int, help="this case alone, with what it printed")
    parser.add_argument("--keep", action="store_true", help="leave the last case on disk")
    parser.add_argument(
        "--folder", type=Path, help="keep whole inputs and their results here between runs of one version"
    )
    parser.add_argument("--log", type=Path, help="a line of JSON for every case")
    args = parser.parse_args()
    folder = args.folder or Path(tempfile.mkdtemp(prefix="dsmap-faults-"))
    folder.mkdir(parents=True, exist_ok=True)
    began, found = time.perf_counter(), []
    try:
        fuzzer = Fuzzer(folder, args.subject)
        if args.cases == 0:
            fuzzer.check()
        numbers = (
            range(args.first, args.first + args.cases)
            if args.only is None
            else range(args.only, args.only + 1)
        )
        log = args.log.open("w") if args.log else None
        for case in cases(fuzzer, args.seed, numbers):
            found.append(case)
            if log is not None:
                row = {"n": case.number, "subject": case.subject, "call": case.call, "damage": case.damaged, "kind": case.outcome.kind, "code": case.outcome.code,
                       "s": round(case.outcome.seconds, 2), "mb": case.outcome.memory >> 20, "place": case.outcome.place, "err": case.outcome.err[-600:]}  # fmt: skip
                log.write(json.dumps(row) + "\n")
                log.flush()
            if args.only is not None:
                print(
                    case.subject,
                    case.call,
                    case.damaged,
                    case.outcome.kind,
                    case.outcome.code,
                    case.outcome.err[-5000:],
                    case.outcome.out[-2000:],
                    sep="\n",
                )
    finally:
        os.chdir("/")
        if args.keep or args.folder:
            print(folder)
        else:
            shutil.rmtree(folder, ignore_errors=True)
    print(summary(found))
    print(f"{(time.perf_counter() - began) / max(len(found), 1) * 1e3:.0f} ms a case")
    return int(any(case.is_fault for case in found))


if __name__ == "__main__":
    sys.exit(main())
