"""Sources of `dsmap live` on packages that stand for the makers': what comes out is a camera's frame."""

import importlib
import sys

import fake_cameras as fakes
import numpy as np
import pytest
from fake_depthai import depthai

from dsmap.errors import InputError
from dsmap.tools.live.sources import CAMERAS, LiveSource, open_source

MODULES = {"oak": "oak", "realsense": "realsense", "record3d": "record3d_phone"}
"""Name of a source to its module in tools/live."""


@pytest.fixture
def plug_in(monkeypatch):
    """Installs a package that stands for a maker's, and opens the source that uses it."""

    def plug(name: str, package) -> LiveSource:
        monkeypatch.setitem(sys.modules, package.__name__, package)
        monkeypatch.delitem(sys.modules, f"dsmap.tools.live.{MODULES[name]}", raising=False)
        return open_source(name)

    yield plug
    for module in MODULES.values():  # the next one who asks gets the maker's
        sys.modules.pop(f"dsmap.tools.live.{module}", None)


PLUGGED_IN = {
    "oak": ("oak", depthai()),
    "oak 4": ("oak", depthai("RVC4")),
    "realsense": ("realsense", fakes.pyrealsense2()),
    "record3d": ("record3d", fakes.record3d()),
}


@pytest.mark.parametrize(("name", "package"), PLUGGED_IN.values(), ids=PLUGGED_IN)
def test_a_camera_gives_frames(plug_in, name, package):
    source = plug_in(name, package)
    k = source.intrinsics
    assert (k.width, k.height) == (fakes.WIDTH, fakes.HEIGHT) and k.distortion is None
    assert (k.fx, k.fy, k.cx, k.cy) == pytest.approx(tuple(fakes.K.values()))
    found = []
    try:
        for frame in source.frames():
            found.append(frame)
    except InputError as error:
        assert name != "record3d" and str(error).startswith(f"{name}: ")  # the phone says when it ends
    first = 1 if name == "record3d" else 0  # the phone's first frame only says how large it is
    assert [frame.index for frame in found] == list(range(fakes.FRAMES))
    for n, frame in enumerate(found, start=first):
        frame.check_size(k)
        assert np.array_equal(frame.rgb, fakes.rgb(n))
        assert frame.depth.dtype == np.float32
        assert np.allclose(frame.depth, fakes.millimetres(n) / 1000, atol=1e-6) and not frame.depth[0].any()
    if name != "record3d":
        assert found[1].time - found[0].time == pytest.approx(1 / 30, abs=1e-5)
        assert found[0].depth_time - found[0].time == pytest.approx(0.004)
        assert not (package.Pipeline if name == "oak" else package.pipeline).running, "it is let go"


@pytest.mark.parametrize(
    ("name", "package", "message"),
    [
        ("oak", depthai(devices=0), "oak: No available devices; expected an OAK that is plugged in"),
        ("oak", depthai(version="2.30.0"), "depthai 2.30.0 is too old"),
        ("realsense", fakes.pyrealsense2(devices=0), "realsense: No device connected; expected a RealSense"),
        ("record3d", fakes.record3d(devices=0), "record3d: found no phone"),
    ],
)
def test_a_camera_that_is_not_there_is_one_sentence(plug_in, name, package, message):
    with pytest.raises(InputError, match=message):
        plug_in(name, package)


def test_a_missing_package_is_named(plug_in, monkeypatch):
    for name, (package, _) in CAMERAS.items():
        monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
        sys.modules.pop(f"dsmap.tools.live.{MODULES[name]}", None)
        with pytest.raises(InputError, match=f"needs {package}; install it with"):
            open_source(name)


def test_depthai_has_what_is_called():
    """Names and keywords of the stand-in are those of the maker's package, where that is installed."""
    dai, fake = pytest.importorskip("depthai", minversion="3"), depthai()
    pairs = [(getattr(fake.node, kind), getattr(dai.node, kind)) for kind in vars(fake.node)]
    pairs += [(fake.Pipeline, dai.Pipeline), (fake.ImgFrame, dai.ImgFrame)]
    for ours, theirs in pairs:
        called = {name for name in vars(ours) if not name.startswith("_") and name != "running"}
        assert called <= set(dir(theirs)), theirs
    for keyword in ("fps", "enableUndistortion"):
        assert f"{keyword}:" in dai.node.Camera.requestOutput.__doc__
    assert hasattr(dai.ImgTransformation, "getIntrinsicMatrix") and hasattr(dai.Platform, "RVC4")
    assert issubclass(dai.MessageQueue.QueueException, Exception)
    importlib.import_module("dsmap.tools.live.oak")
