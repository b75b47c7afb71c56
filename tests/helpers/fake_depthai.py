"""depthai 3 as far as dsmap calls it: frames come only through a pipeline whose links bring colour, and depth aligned
to it, to `sync`. See fake_cameras.
"""

from datetime import timedelta
from types import ModuleType, SimpleNamespace

from fake_cameras import FRAMES, HEIGHT, WIDTH, K, millimetres, rgb


class QueueException(Exception):
    pass


class Output:
    def __init__(self, node, name):
        self.node, self.name, self.fed = node, name, []

    def link(self, target):
        target.sources.append(self)

    def createOutputQueue(self, maxSize=16, blocking=True):
        assert not blocking, "a slow mapper would get old frames"
        return Queue(self.node)


class Input:
    def __init__(self):
        self.sources = []

    def comes_from(self, kind, name):
        return [s.node.__class__.__name__ == kind and s.name == name for s in self.sources] == [True]


class Camera:
    def build(self, socket):
        self.socket = socket
        return self

    def requestOutput(self, size, fps=None, enableUndistortion=None):
        self.undistorted = bool(enableUndistortion)
        return Output(self, "video")


class StereoDepth:
    def __init__(self):
        self.left, self.right, self.inputAlignTo = Input(), Input(), Input()
        self.depth = Output(self, "depth")

    def setLeftRightCheck(self, on):
        pass

    def setSubpixel(self, on):
        pass


class ImageAlign:
    def __init__(self):
        self.input, self.inputAlignTo = Input(), Input()
        self.outputAligned = Output(self, "outputAligned")


class Sync:
    def __init__(self):
        self.inputs = {"rgb": Input(), "depth": Input()}
        self.out = Output(self, "out")

    def setSyncThreshold(self, threshold):
        assert isinstance(threshold, timedelta)


class Queue:
    def __init__(self, sync):
        self.sync, self.count = sync, 0

    def get(self, timeout):
        assert isinstance(timeout, timedelta) and self.sync.pipeline.running
        colour, depth = self.sync.inputs["rgb"], self.sync.inputs["depth"]
        assert colour.comes_from("Camera", "video")
        camera = colour.sources[0].node
        assert camera.socket == "CAM_A" and camera.undistorted
        if self.sync.pipeline.platform == "RVC4":
            assert depth.comes_from("ImageAlign", "outputAligned")
            stereo, aligned = depth.sources[0].node.input.sources[0].node, depth.sources[0].node
        else:
            assert depth.comes_from("StereoDepth", "depth")
            stereo = aligned = depth.sources[0].node
        assert [s.node for s in aligned.inputAlignTo.sources] == [camera], "depth is in colour's view"
        assert [side.sources[0].node.socket for side in (stereo.left, stereo.right)] == ["CAM_B", "CAM_C"]
        if self.count == FRAMES:
            raise QueueException("the queue is closed")
        self.count += 1
        return {"rgb": Image(self.count - 1, "rgb"), "depth": Image(self.count - 1, "depth")}


class Image:
    def __init__(self, n, kind):
        self.n, self.kind = n, kind

    def getTimestamp(self):
        return timedelta(seconds=100 + self.n / 30 + (0.004 if self.kind == "depth" else 0))

    def getWidth(self):
        return WIDTH

    def getHeight(self):
        return HEIGHT

    def getCvFrame(self):
        return rgb(self.n)[..., ::-1]

    def getFrame(self):
        return millimetres(self.n)

    def getTransformation(self):
        matrix = [[K["fx"], 0.0, K["cx"]], [0.0, K["fy"], K["cy"]], [0.0, 0.0, 1.0]]
        return SimpleNamespace(getIntrinsicMatrix=lambda: matrix)


def depthai(platform: str = "RVC2", devices: int = 1, version: str = "3.12.0") -> ModuleType:
    """The package, with cameras of one platform plugged in."""
    dai = ModuleType("depthai")

    class Pipeline:
        running = False

        def __init__(self):
            if not devices:
                raise RuntimeError("No available devices")
            self.platform = platform

        def create(self, kind):
            node = kind()
            node.pipeline = self
            return node

        def getDefaultDevice(self):
            return SimpleNamespace(getPlatform=lambda: getattr(dai.Platform, platform))

        def start(self):
            Pipeline.running = True

        def stop(self):
            Pipeline.running = False

    dai.__version__ = version
    dai.CameraBoardSocket = SimpleNamespace(CAM_A="CAM_A", CAM_B="CAM_B", CAM_C="CAM_C")
    dai.Platform = SimpleNamespace(RVC2="RVC2", RVC4="RVC4")
    dai.MessageQueue = SimpleNamespace(QueueException=QueueException)
    dai.node = SimpleNamespace(Camera=Camera, StereoDepth=StereoDepth, Sync=Sync, ImageAlign=ImageAlign)
    dai.Pipeline, dai.ImgFrame = Pipeline, Image
    return dai
