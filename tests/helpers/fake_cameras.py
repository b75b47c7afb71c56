"""The packages of live cameras as far as dsmap calls them: they hand out two frames and are then unplugged.

What they do with a call is what the makers' documents say of it; a call that is missing here is an AttributeError.
"""

from types import ModuleType, SimpleNamespace

import numpy as np

WIDTH, HEIGHT = 32, 24
K = {"fx": 40.0, "fy": 41.0, "cx": 15.25, "cy": 11.75}
FRAMES = 2


def rgb(n: int) -> np.ndarray:
    """Colour of frame `n`, uint8, shape (H, W, 3): no two channels are alike."""
    return np.random.default_rng(n).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def millimetres(n: int) -> np.ndarray:
    """Depth of frame `n`, uint16, shape (H, W); the first row has none."""
    depth = np.random.default_rng(100 + n).integers(500, 4000, (HEIGHT, WIDTH)).astype(np.uint16)
    depth[0] = 0
    return depth


def pyrealsense2(devices: int = 1) -> ModuleType:
    """pyrealsense2: colour as RGB, depth in units of a quarter of a millimetre, in its own view until it is aligned."""
    rs = ModuleType("pyrealsense2")
    video = SimpleNamespace(
        get_intrinsics=lambda: SimpleNamespace(
            width=WIDTH, height=HEIGHT, fx=K["fx"], fy=K["fy"], ppx=K["cx"], ppy=K["cy"]
        )
    )
    profile = SimpleNamespace(
        get_device=lambda: SimpleNamespace(
            first_depth_sensor=lambda: SimpleNamespace(get_depth_scale=lambda: 0.00025)
        ),
        get_stream=lambda stream: SimpleNamespace(as_video_stream_profile=lambda: video),
    )

    class Config:
        def __init__(self):
            self.streams = {}

        def enable_stream(self, stream, width, height, form, fps):
            self.streams[stream] = form

    class Pipeline:
        running = False

        def start(self, config):
            if not devices:
                raise RuntimeError("No device connected")
            assert config.streams == {"color": "rgb8", "depth": "z16"}
            Pipeline.running, self.count = True, 0
            return profile

        def wait_for_frames(self, timeout_ms):
            if self.count == FRAMES:
                raise RuntimeError("Frame didn't arrive within 5000")
            self.count += 1
            return self.count - 1

        def stop(self):
            Pipeline.running = False

    class Align:
        def __init__(self, stream):
            assert stream == "color"

        def process(self, n):
            colour = SimpleNamespace(get_data=lambda: rgb(n), get_timestamp=lambda: 1e5 + n * 1e3 / 30)
            depth = SimpleNamespace(
                get_data=lambda: millimetres(n) * 4, get_timestamp=lambda: 1e5 + n * 1e3 / 30 + 4
            )
            return SimpleNamespace(get_color_frame=lambda: colour, get_depth_frame=lambda: depth)

    rs.config, rs.pipeline, rs.align = Config, Pipeline, Align
    rs.stream = SimpleNamespace(color="color", depth="depth")
    rs.format = SimpleNamespace(rgb8="rgb8", z16="z16")
    return rs


def record3d(devices: int = 1) -> ModuleType:
    """record3d: a stream calls back for every frame; colour is twice as large as depth, which is in metres."""
    module = ModuleType("record3d")

    class Record3DStream:
        on_new_frame = on_stream_stopped = None

        @staticmethod
        def get_connected_devices():
            return list(range(devices))

        def connect(self, device):
            self.n = 0
            self.on_new_frame()

        def get_intrinsic_mat(self):
            return SimpleNamespace(
                fx=2 * K["fx"], fy=2 * K["fy"], tx=2 * (K["cx"] + 0.5) - 0.5, ty=2 * (K["cy"] + 0.5) - 0.5
            )

        def get_rgb_frame(self):
            colour = rgb(self.n).repeat(2, axis=0).repeat(2, axis=1)
            self.n += 1
            (self.on_new_frame if self.n < FRAMES + 1 else self.on_stream_stopped)()
            return colour

        def get_depth_frame(self):
            depth = millimetres(self.n).astype(np.float32) / 1000
            return np.where(depth == 0, np.float32(np.nan), depth)

    module.Record3DStream = Record3DStream
    return module
