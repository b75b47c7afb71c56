"""Bags as ROS 1, ROS 2 and the RealSense SDK write them, through rosbags' writers."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from recording_shots import CAMERA, Shot, png16
from scipy.spatial.transform import Rotation

from dsmap.frame import Intrinsics
from dsmap.sequences.formats.bag import typestore

COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"


class BagWriter:
    """One bag; messages are made by type name, ROS 1 or ROS 2 alike."""

    def __init__(self, path: Path, kind: str, chunks: bool = True):
        """`kind`: ros1, sqlite3 or mcap."""
        from rosbags import rosbag1, rosbag2

        self.is_ros1 = kind == "ros1"
        self.store = typestore(path, self.is_ros1)
        if self.is_ros1:
            self._writer: Any = rosbag1.Writer(path)
            if not chunks:
                self._writer.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
        else:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            self._writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        self._topics: dict[str, Any] = {}

    def __enter__(self) -> "BagWriter":
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def time(self, seconds: float) -> Any:
        nanoseconds = round(seconds * 1e6) * 1000
        return self.make("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

    def header(self, seconds: float, frame_id: str) -> Any:
        fields = {"seq": 0} if self.is_ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=self.time(seconds), frame_id=frame_id, **fields)

    def write(self, topic: str, message: Any, seconds: float) -> None:
        name = message.__msgtype__
        if topic not in self._topics:
            self._topics[topic] = self._writer.add_connection(topic, name, typestore=self.store)
        raw = (self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr)(message, name)
        self._writer.write(self._topics[topic], round(seconds * 1e9), raw)

    def image(
        self, topic: str, seconds: float, frame_id: str, pixels: np.ndarray, encoding: str, pad: int = 0
    ) -> None:
        """`pad`: bytes that are added to each row."""
        rows = np.ascontiguousarray(pixels).reshape(pixels.shape[0], -1).view(np.uint8)
        rows = np.pad(rows, ((0, 0), (0, pad)), constant_values=7)
        message = self.make(
            "sensor_msgs/msg/Image", header=self.header(seconds, frame_id), height=pixels.shape[0],
            width=pixels.shape[1], encoding=encoding, is_bigendian=0, step=rows.shape[1], data=rows.ravel(),
        )  # fmt: skip
        self.write(topic, message, seconds + 0.004)

    def compressed(self, topic: str, seconds: float, frame_id: str, data: bytes, format: str) -> None:
        message = self.make(
            "sensor_msgs/msg/CompressedImage", header=self.header(seconds, frame_id), format=format,
            data=np.frombuffer(data, np.uint8),
        )  # fmt: skip
        self.write(topic, message, seconds + 0.004)

    def camera_info(
        self, topic: str, seconds: float, frame_id: str, camera: Intrinsics, D: tuple = ()
    ) -> None:
        K, P = camera.K.ravel(), np.hstack([camera.K, np.zeros((3, 1))]).ravel()
        roi = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        values = {"d": np.array(D, np.float64), "k": K, "r": np.eye(3).ravel(), "p": P}
        message = self.make(
            "sensor_msgs/msg/CameraInfo", header=self.header(seconds, frame_id), height=camera.height,
            width=camera.width, distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=roi,
            **{key.upper() if self.is_ros1 else key: v for key, v in values.items()},
        )  # fmt: skip
        self.write(topic, message, seconds)

    def transform(self, T: np.ndarray) -> Any:
        t, q = T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_quat()
        return self.make(
            "geometry_msgs/msg/Transform",
            translation=self.make("geometry_msgs/msg/Vector3", x=t[0], y=t[1], z=t[2]),
            rotation=self.make("geometry_msgs/msg/Quaternion", x=q[0], y=q[1], z=q[2], w=q[3]),
        )

    def tf(self, topic: str, seconds: float, links: list[tuple[str, str, np.ndarray]]) -> None:
        """Links as parent, child, T_parent_child."""
        stamped = [
            self.make(
                "geometry_msgs/msg/TransformStamped", header=self.header(seconds, parent), child_frame_id=child,
                transform=self.transform(T),
            )
            for parent, child, T in links
        ]  # fmt: skip
        self.write(topic, self.make("tf2_msgs/msg/TFMessage", transforms=stamped), seconds)


def write_ros(path: Path, shots: list[Shot], kind: str) -> Path:
    """Colour, depth registered to it, camera_info, poses in /tf, and an infrared topic that is not wanted."""
    optical = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    with BagWriter(path, kind) as bag:
        bag.tf("/tf_static", shots[0].time - 0.1, [("camera_link", "camera_color_optical_frame", optical)])
        for s in shots:
            T_map_link = s.T_world_camera @ np.linalg.inv(optical)
            bag.tf("/tf", s.time, [("map", "camera_link", T_map_link)])
            bag.camera_info("/camera/color/camera_info", s.time, "camera_color_optical_frame", CAMERA)
            bag.camera_info(
                "/camera/aligned_depth_to_color/camera_info", s.time, "camera_color_optical_frame", CAMERA
            )
            bag.image(COLOR, s.time, "camera_color_optical_frame", s.rgb[..., ::-1], "bgr8", pad=5)
            bag.image(DEPTH, s.time, "camera_color_optical_frame", s.millimetres, "16UC1")
            bag.image(
                "/camera/infra1/image_rect_raw", s.time, "camera_infra1_optical_frame", s.rgb[..., 0], "mono8"
            )
    return path


def write_ros_compressed(path: Path, shots: list[Shot], kind: str) -> Path:
    """JPEG colour and PNG depth, as image_transport sends them."""
    with BagWriter(path, kind) as bag:
        for s in shots:
            bag.camera_info("/camera/color/camera_info", s.time, "color", CAMERA)
            bag.compressed(f"{COLOR}/compressed", s.time, "color", s.jpeg, "bgr8; jpeg compressed bgr8")
            head = struct.pack("<iff", 0, 0.0, 0.0)
            bag.compressed(
                f"{DEPTH}/compressedDepth",
                s.time,
                "color",
                head + png16(s.millimetres),
                "16UC1; compressedDepth png",
            )
    return path


def write_ros1(path: Path, shots: list[Shot]) -> Path:
    return write_ros(path / "room.bag", shots, "ros1")


def write_ros1_compressed(path: Path, shots: list[Shot]) -> Path:
    return write_ros_compressed(path / "room.bag", shots, "ros1")


def write_ros2_db3(path: Path, shots: list[Shot]) -> Path:
    return write_ros(path / "room", shots, "sqlite3")


def write_ros2_db3_file(path: Path, shots: list[Shot]) -> Path:
    return next(write_ros(path / "room", shots, "sqlite3").glob("*.db3"))


def write_ros2_mcap(path: Path, shots: list[Shot]) -> Path:
    return write_ros(path / "room", shots, "mcap")


def write_ros2_mcap_file(path: Path, shots: list[Shot]) -> Path:
    return next(write_ros_compressed(path / "room", shots, "mcap").glob("*.mcap"))


def write_realsense(
    path: Path,
    shots: list[Shot],
    depth_camera: Intrinsics = CAMERA,
    T_color_depth: np.ndarray | None = None,
    units_m: float = 0.001,
    edit: Callable[[BagWriter], None] = lambda bag: None,
) -> Path:
    """A recording of the RealSense SDK, version 3 of its topics."""
    base = "/device_0/sensor_"
    depth, color = f"{base}0/Depth_0", f"{base}1/Color_0"
    file = path / "20260101_120000.bag"
    with BagWriter(file, "ros1") as bag:
        begin = 1e-9  # the SDK records what does not change at the first moment
        edit(bag)
        bag.write("/file_version", bag.make("std_msgs/msg/UInt32", data=3), begin)
        bag.write(
            f"{base}0/option/Depth Units/value",
            bag.make("std_msgs/msg/Float32", data=np.float32(units_m)),
            begin,
        )
        bag.camera_info(f"{depth}/info/camera_info", begin, "0", depth_camera, (0.0,) * 5)
        bag.camera_info(f"{color}/info/camera_info", begin, "0", CAMERA, (0.0,) * 5)
        bag.write(f"{depth}/tf/0", bag.transform(np.eye(4)), begin)
        bag.write(
            f"{color}/tf/0", bag.transform(np.eye(4) if T_color_depth is None else T_color_depth), begin
        )
        for s in shots:
            bag.image(f"{depth}/image/data", s.time, "0", s.stored(1 / units_m), "mono16")
            bag.image(f"{color}/image/data", s.time, "0", s.rgb, "rgb8")
            bag.image(f"{base}0/Infrared_1/image/data", s.time, "0", s.rgb[..., 0], "mono8")
    return file


def rvl_encoded(depth: np.ndarray) -> bytes:
    """Wilson's RVL of a depth image, uint16, number by number."""
    nibbles: list[int] = []

    def put(value: int) -> None:
        while True:
            rest = value >> 3
            nibbles.append((value & 7) | (8 if rest else 0))
            value = rest
            if not value:
                return

    values, at, last = depth.ravel().astype(int).tolist(), 0, 0
    while at < len(values):
        zeros = next((i for i, v in enumerate(values[at:]) if v), len(values) - at)
        at += zeros
        count = next((i for i, v in enumerate(values[at:]) if not v), len(values) - at)
        put(zeros)
        put(count)
        for value in values[at : at + count]:
            delta, last = value - last, value
            put((delta << 1) ^ (delta >> 31))
        at += count
    nibbles += [0] * (-len(nibbles) % 8)
    words = [
        sum(n << (28 - 4 * i) for i, n in enumerate(nibbles[k : k + 8])) for k in range(0, len(nibbles), 8)
    ]
    return struct.pack("<II", depth.shape[1], depth.shape[0]) + np.array(words, "<u4").tobytes()
