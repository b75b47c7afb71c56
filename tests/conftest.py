"""What tests share: where the real recordings are, one thread for torch."""

import os
from pathlib import Path

import pytest


def shared_data(*parts: str) -> Path:
    """A file or folder of the real data (`DSMAP_SHARED`, or `shared/data` beside the checkout), else skip."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    path = Path(os.environ.get("DSMAP_SHARED", default)).joinpath(*parts)
    if not path.exists():
        pytest.skip(f"real data {'/'.join(parts)} is not here: set DSMAP_SHARED to the folder that holds it")
    return path


@pytest.fixture
def one_thread():
    """Torch sums in one order whatever else the machine does, and is quicker at the size of tests."""
    torch = pytest.importorskip("torch")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
