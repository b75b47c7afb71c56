"""`dsmap kernel-resources`: registers, spills and shared memory of every kernel as compiled for CUDA.

Warp brings the compiler to PTX, `ptxas` of the CUDA toolkit the rest: no GPU is needed.
"""

import importlib
import pkgutil
import re
import shutil
import subprocess
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import warp as wp

import dsmap.kernels
from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.ranges import Range

_THREADS = 256
"""Of a block, as Warp launches kernels."""
_REGISTERS, _WARPS = 65536, 64
"""Of a multiprocessor, sm_80 and sm_90 alike."""


@dataclass
class Args:
    arch: tuple[Annotated[int, Range(50, 200)], ...] = (80, 90)
    """Compute capabilities, e.g. 80 90."""
    module: str | None = None
    """Only this file of kernels/, e.g. odometry; default: all."""
    out: Path | None = None
    """File for the table, as JSON."""


@dataclass(frozen=True)
class Resources:
    """Of one kernel."""

    module: str
    kernel: str
    arch: int
    registers: int
    spills: int
    """Bytes that are stored to memory for want of registers."""
    stack: int
    """Bytes of local memory."""
    shared: int
    """Bytes of a block."""

    @property
    def occupancy(self) -> float:
        """Share of a multiprocessor's warps that its registers allow."""
        per_block = -(-self.registers // 8) * 8 * _THREADS
        blocks = min(_REGISTERS // max(per_block, 1), _WARPS * 32 // _THREADS)
        return blocks * _THREADS / (_WARPS * 32)


def main(args: Args) -> int:
    """Compile, print the table, write it; 1 if a kernel spills.

    Raises:
        InputError: no ptxas, or no such file of kernels.
    """
    if shutil.which("ptxas") is None:
        raise InputError("ptxas is not on the path; expected the CUDA toolkit's (package cuda-nvcc)")
    names = [module.name for module in pkgutil.iter_modules(dsmap.kernels.__path__)]
    if args.module is not None and args.module not in names:
        raise InputError(f"--module is {args.module!r}; expected one of {', '.join(names)}")
    rows = []
    print(
        f"{'kernel':<40} {'arch':>5} {'registers':>9} {'spills':>7} {'stack':>6} {'shared':>7} {'occupancy':>9}"
    )
    for name in [args.module] if args.module else names:
        for arch in args.arch:
            for row in compiled(name, arch):
                rows.append(row)
                print(
                    f"{row.module + '.' + row.kernel:<40} {row.arch:5} {row.registers:9} {row.spills:7} {row.stack:6} "
                    f"{row.shared:7} {row.occupancy:9.0%}"
                )
    if args.out is not None:
        write_json(args.out, [asdict(row) | {"occupancy": row.occupancy} for row in rows])
    spilling = sorted({f"{row.module}.{row.kernel}" for row in rows if row.spills})
    print(f"spill: {', '.join(spilling)}" if spilling else "no kernel spills")
    return 1 if spilling else 0


def compiled(name: str, arch: int) -> list[Resources]:
    """Resources of the kernels of one file; none if there are none in it."""
    module = importlib.import_module(f"dsmap.kernels.{name}")
    if not wp.get_module(module.__name__).kernels:
        return []
    with tempfile.TemporaryDirectory() as folder:
        wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=True)
        ptx = next(Path(folder).glob("*.ptx"))
        told = _ptxas(ptx, arch)
        older = re.search(r"current version is '([\d.]+)'", told.stderr)
        if (
            older is not None
        ):  # Warp's compiler is newer than the toolkit; what kernels need, older versions know
            ptx.write_text(
                re.sub(
                    r"(?m)^\.version .*$", f".version {older.group(1)}", ptx.read_text().rstrip("\0"), count=1
                )
            )
            told = _ptxas(ptx, arch)
        if told.returncode:
            raise InputError(f"ptxas refused {name} for sm_{arch}: {told.stderr.strip().splitlines()[0]}")
    return parsed(told.stderr, name, arch)


def _ptxas(ptx: Path, arch: int) -> subprocess.CompletedProcess:
    command = ["ptxas", "-v", f"-arch=sm_{arch}", str(ptx), "-o", str(ptx.with_suffix(".out"))]
    return subprocess.run(command, capture_output=True, text=True)


def parsed(told: str, module: str, arch: int) -> list[Resources]:
    """What `ptxas -v` says of each kernel."""
    rows = []
    for part in told.split("Compiling entry function")[1:]:
        symbol = re.search(r"'(\w+?)_[0-9a-f]{6,}_cuda_kernel_forward'", part)
        used = re.search(r"Used (\d+) registers", part)
        spilt, stack = (
            re.search(r"(\d+) bytes spill stores", part),
            re.search(r"(\d+) bytes stack frame", part),
        )
        shared = re.search(r"(\d+) bytes smem", part)
        if symbol is None or used is None:
            continue
        numbers = [int(found.group(1)) if found else 0 for found in (used, spilt, stack, shared)]
        rows.append(Resources(module, symbol.group(1), arch, *numbers))
    return rows
