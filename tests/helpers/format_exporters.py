"""The recording of recording_shots.py in the formats of data sets, phones and cameras other than ROS's."""

import json
import shutil
import struct
import zipfile
import zlib
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from recording_shots import CAMERA, Shot, png16
from scipy.spatial.transform import Rotation

from dsmap.classes import CLASS_TO_NYU40
from dsmap.frame import Intrinsics
from dsmap.sequences.associate import pose_vector

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def matrix(T: np.ndarray) -> str:
    return "\n".join(" ".join(f"{v:.9g}" for v in row) for row in T) + "\n"


def k4(camera: Intrinsics = CAMERA) -> np.ndarray:
    K = np.eye(4)
    K[:3, :3] = camera.K
    return K


def write_sens(path: Path, shots: list[Shot], compression: int = 1) -> Path:
    """ScanNet's .sens, version 4; `compression` of depth: 0 raw, 1 zlib."""
    file, name = path / "scene0000_00.sens", b"StructureSensor"
    data = [struct.pack("<IQ", 4, len(name)), name]
    for matrix_ in (k4(), np.eye(4), k4(), np.eye(4)):
        data.append(matrix_.astype("<f4").tobytes())
    size = (CAMERA.width, CAMERA.height)
    data.append(struct.pack("<iiIIIIfQ", 2, compression, *size, *size, 1000.0, len(shots)))
    for s in shots:
        depth = s.millimetres.astype("<u2").tobytes()
        depth = zlib.compress(depth) if compression else depth
        stamp = round(s.time * 1e6)
        data.append(
            s.T_world_camera.astype("<f4").tobytes()
            + struct.pack("<QQQQ", stamp, stamp, len(s.jpeg), len(depth))
        )
        data += [s.jpeg, depth]
    data.append(struct.pack("<Q", 0))  # no IMU frames
    file.write_bytes(b"".join(data))
    return file


def write_scannet(path: Path, shots: list[Shot]) -> Path:
    path.mkdir(exist_ok=True)
    for name in ("color", "depth", "pose", "intrinsic", "label"):
        (path / name).mkdir()
    for k, s in enumerate(shots):
        (path / f"color/{k}.jpg").write_bytes(s.jpeg)
        (path / f"depth/{k}.png").write_bytes(png16(s.millimetres))
        (path / f"label/{k}.png").write_bytes(png16(CLASS_TO_NYU40[s.label]))
        (path / f"pose/{k}.txt").write_text(matrix(s.T_world_camera))
    for name in ("color", "depth"):
        (path / f"intrinsic/intrinsic_{name}.txt").write_text(matrix(k4()))
        (path / f"intrinsic/extrinsic_{name}.txt").write_text(matrix(np.eye(4)))
    return path


def write_replica(path: Path, shots: list[Shot]) -> Path:
    scene = path / "room0"
    (scene / "results").mkdir(parents=True)
    for k, s in enumerate(shots):
        (scene / f"results/frame{k:06d}.jpg").write_bytes(s.jpeg)
        (scene / f"results/depth{k:06d}.png").write_bytes(png16(s.stored(6553.5)))
    (scene / "traj.txt").write_text(
        "".join(" ".join(f"{v:.18e}" for v in s.T_world_camera.ravel()) + "\n" for s in shots)
    )
    c = CAMERA
    camera = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "scale": 6553.5}
    (path / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return scene


def write_replica_of_nerf(path: Path, shots: list[Shot]) -> Path:
    """As rendered for Semantic-NeRF."""
    for name in ("rgb", "depth"):
        (path / name).mkdir()
    for k, s in enumerate(shots):
        (path / f"rgb/rgb_{k}.png").write_bytes(s.png)
        (path / f"depth/depth_{k}.png").write_bytes(png16(s.millimetres))
    (path / "traj_w_c.txt").write_text(
        "".join(" ".join(f"{v:.18e}" for v in s.T_world_camera.ravel()) + "\n" for s in shots)
    )
    c = CAMERA
    camera = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "scale": 1000.0}
    (path / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return path


def write_icl(path: Path, shots: list[Shot]) -> Path:
    """The TUM-compatible folders; the ground truth has mirrored axes and begins at frame 1."""
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    for name in ("rgb", "depth"):
        (path / name).mkdir()
    truth = []
    for k, s in enumerate(shots):
        (path / f"rgb/{k}.png").write_bytes(s.png)
        (path / f"depth/{k}.png").write_bytes(png16(s.stored(5000)))
        pose = pose_vector(mirror @ s.T_world_camera @ mirror)
        truth.append(f"{k} " + " ".join(f"{v:.9f}" for v in pose))
    (path / "livingRoom0.gt.freiburg").write_text("\n".join(truth) + "\n")
    (path / "associations.txt").write_text(
        "".join(f"{k} depth/{k}.png {k} rgb/{k}.png\n" for k in range(len(shots)))
    )
    return path


def write_icl_original(path: Path, shots: list[Shot], camera: Intrinsics) -> Path:
    """PNG, distances from the camera's centre and POV-Ray's camera."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    stretch = np.sqrt(((x - camera.cx) / camera.fx) ** 2 + ((y - camera.cy) / camera.fy) ** 2 + 1)
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    for k, s in enumerate(shots):
        stem = path / f"scene_00_{k:04d}"
        stem.with_suffix(".png").write_bytes(s.png)
        stem.with_suffix(".depth").write_text(
            " ".join(f"{v:.7f}" for v in (s.metres * stretch).ravel()) + " \n"
        )
        T = mirror @ s.T_world_camera @ mirror
        lines = (("cam_pos", T[:3, 3]), ("cam_dir", T[:3, 2]), ("cam_up", T[:3, 1]))
        stem.with_suffix(".txt").write_text(
            "".join(f"{name} = [{', '.join(f'{v:.9f}' for v in values)}]';\n" for name, values in lines)
        )
    return path


def write_sun3d(path: Path, shots: list[Shot]) -> Path:
    for name in ("image", "depth", "extrinsics"):
        (path / name).mkdir()
    for k, s in enumerate(shots):
        stamp = round((s.time - shots[0].time) * 1e6)
        turned = (s.millimetres << 3) | (s.millimetres >> 13)
        (path / f"image/{k + 1:07d}-{stamp:012d}.jpg").write_bytes(s.jpeg)
        (path / f"depth/{k + 1:07d}-{stamp:012d}.png").write_bytes(png16(turned))
    (path / "intrinsics.txt").write_text(matrix(CAMERA.K))
    (path / "extrinsics/20140101000000.txt").write_text("".join(matrix(s.T_world_camera[:3]) for s in shots))
    return path


def write_bundlefusion(path: Path, shots: list[Shot]) -> Path:
    for k, s in enumerate(shots):
        stem = path / f"frame-{k:06d}"
        stem.with_suffix(".color.jpg").write_bytes(s.jpeg)
        stem.with_suffix(".depth.png").write_bytes(png16(s.millimetres))
        stem.with_suffix(".pose.txt").write_text(matrix(s.T_world_camera))
    row = " ".join(f"{v:.9g}" for v in k4().ravel())
    same = " ".join(f"{v:g}" for v in np.eye(4).ravel())
    lines = ["m_versionNumber = 4", "m_sensorName = StructureSensor"]
    for what in ("color", "depth"):
        lines += [f"m_{what}Width = {CAMERA.width}", f"m_{what}Height = {CAMERA.height}"]
    lines.append("m_depthShift = 1000")
    for what in ("Color", "Depth"):
        lines += [f"m_calibration{what}Intrinsic = {row}", f"m_calibration{what}Extrinsic = {same}"]
    (path / "info.txt").write_text("\n".join([*lines, f"m_frames.size = {len(shots)}"]) + "\n")
    return path


def write_eth3d(path: Path, shots: list[Shot]) -> Path:
    """TUM's lists and `calibration.txt`."""
    for name in ("rgb", "depth"):
        (path / name).mkdir()
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for s in shots:
        stamp = f"{s.time:.6f}"
        (path / f"rgb/{stamp}.png").write_bytes(s.png)
        (path / f"depth/{stamp}.png").write_bytes(png16(s.stored(5000)))
        lists["rgb"].append(f"{stamp} rgb/{stamp}.png")
        lists["depth"].append(f"{stamp} depth/{stamp}.png")
        lists["groundtruth"].append(stamp + "".join(f" {v:.9f}" for v in pose_vector(s.T_world_camera)))
    for name, lines in lists.items():
        (path / f"{name}.txt").write_text("\n".join(lines) + "\n")
    pairs = zip(lists["rgb"], lists["depth"], strict=True)
    (path / "associated.txt").write_text("".join(f"{a} {b}\n" for a, b in pairs))
    (path / "calibration.txt").write_text(f"{CAMERA.fx} {CAMERA.fy} {CAMERA.cx} {CAMERA.cy}\n")
    return path


def write_nerfstudio(path: Path, shots: list[Shot]) -> Path:
    for name in ("images", "depths"):
        (path / name).mkdir()
    frames = []
    for k, s in enumerate(shots):
        (path / f"images/frame_{k + 1:05d}.png").write_bytes(s.png)
        (path / f"depths/frame_{k + 1:05d}.png").write_bytes(png16(s.millimetres))
        frames.append(
            {
                "file_path": f"./images/frame_{k + 1:05d}.png",
                "depth_file_path": f"depths/frame_{k + 1:05d}.png",
                "transform_matrix": (s.T_world_camera @ OPENGL).tolist(),
            }
        )
    c = CAMERA
    camera = {"w": c.width, "h": c.height, "fl_x": c.fx, "fl_y": c.fy, "cx": c.cx + 0.5, "cy": c.cy + 0.5}
    content = {"camera_model": "OPENCV", **camera, "frames": frames[::-1]}
    (path / "transforms.json").write_text(json.dumps(content))
    return path


def write_record3d(path: Path, shots: list[Shot], depth_size: tuple[int, int] | None = None) -> Path:
    import liblzfse

    c, size = CAMERA, depth_size or (CAMERA.width, CAMERA.height)
    poses = [np.roll(pose_vector(s.T_world_camera @ OPENGL), -3).tolist() for s in shots]
    metadata = {
        "w": c.width, "h": c.height, "dw": size[0], "dh": size[1], "fps": 30, "K": c.K.T.ravel().tolist(),
        "poses": poses, "frameTimestamps": [s.time for s in shots], "cameraType": 1,
        "perFrameIntrinsicCoeffs": [[c.fx, c.fy, c.cx, c.cy] for _ in shots],
    }  # fmt: skip
    with zipfile.ZipFile(path / "room.r3d", "w") as archive:
        archive.writestr("metadata", json.dumps(metadata))
        for k, s in enumerate(shots):
            depth = cv2.resize(s.metres, size, interpolation=cv2.INTER_NEAREST)
            archive.writestr(f"rgbd/{k}.jpg", s.jpeg)
            archive.writestr(f"rgbd/{k}.depth", liblzfse.compress(depth.tobytes()))
            archive.writestr(f"rgbd/{k}.conf", liblzfse.compress(np.full(depth.shape, 2, np.uint8).tobytes()))
    return path / "room.r3d"


def write_film(
    file: Path, tracks: dict[str, tuple[str, str, str, list[np.ndarray]]], attached: bytes | None = None
) -> None:
    """Tracks by title: codec, pixel format in the film, pixel format of the arrays, images at 30 Hz."""
    import av

    options = {"allow_raw_vfw": "1", "write_crc32": "0"} if file.suffix == ".mkv" else {}
    with av.open(str(file), "w", options=options) as film:
        streams = []
        for title, (codec, stored, given, images) in tracks.items():
            options = {"qp": "0", "g": "5"} if codec.startswith("libx264") else {}
            stream = film.add_stream(codec, rate=30, options=options)
            stream.height, stream.width = images[0].shape[:2]
            stream.pix_fmt, stream.time_base = stored, Fraction(1, 30)
            stream.metadata["title"] = title
            streams.append((stream, given, images))
        if attached is not None:
            film.add_attachment("calibration.json", "application/octet-stream", attached)
        for k in range(len(streams[0][2])):
            for stream, given, images in streams:
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(images[k]), format=given)
                frame.pts, frame.time_base = k, Fraction(1, 30)
                film.mux(stream.encode(frame))
        for stream, _, _ in streams:
            film.mux(stream.encode(None))
    if any(codec == "rawvideo" for codec, *_ in tracks.values()):
        # FFmpeg leaves the name of raw pixels out; the recorder of Azure Kinect writes b16g.
        height, width = next(iter(tracks.values()))[3][0].shape[:2]
        unnamed = struct.pack("<IiiHHI", 40, width, -height, 1, 16, 0)
        file.write_bytes(
            file.read_bytes().replace(unnamed, struct.pack("<IiiHH4s", 40, width, height, 1, 16, b"b16g"))
        )


def write_stray(path: Path, shots: list[Shot]) -> Path:
    for name in ("depth", "confidence"):
        (path / name).mkdir()
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for k, s in enumerate(shots):
        (path / f"depth/{k:06d}.png").write_bytes(png16(s.millimetres))
        (path / f"confidence/{k:06d}.png").write_bytes(png16(np.full(s.millimetres.shape, 2, np.uint8)))
        pose = ", ".join(f"{v:.9f}" for v in pose_vector(s.T_world_camera))
        lines.append(f"{s.time:.6f}, {k:06d}, {pose}")
    (path / "odometry.csv").write_text("\n".join(lines) + "\n")
    (path / "camera_matrix.csv").write_text(
        "\n".join(", ".join(f"{v:.9g}" for v in row) for row in CAMERA.K) + "\n"
    )
    write_film(path / "rgb.mp4", {"rgb": ("libx264rgb", "rgb24", "rgb24", [s.rgb for s in shots])})
    return path


def write_arkit(path: Path, shots: list[Shot]) -> Path:
    name = "41048190"
    for folder in ("lowres_wide", "lowres_depth", "lowres_wide_intrinsics", "confidence"):
        (path / folder).mkdir()
    c, lines = CAMERA, []
    for s in shots:
        stem = f"{name}_{s.time:.3f}"
        (path / f"lowres_wide/{stem}.png").write_bytes(s.png)
        (path / f"lowres_depth/{stem}.png").write_bytes(png16(s.millimetres))
        (path / f"confidence/{stem}.png").write_bytes(png16(np.full(s.millimetres.shape, 2, np.uint8)))
        (path / f"lowres_wide_intrinsics/{stem}.pincam").write_text(
            f"{c.width} {c.height} {c.fx} {c.fy} {c.cx} {c.cy}"
        )
        T = np.linalg.inv(s.T_world_camera)
        values = [*Rotation.from_matrix(T[:3, :3]).as_rotvec(), *T[:3, 3]]
        lines.append(f"{s.time:.3f} " + " ".join(f"{v:.9f}" for v in values))
    (path / "lowres_wide.traj").write_text("\n".join(lines) + "\n")
    return path


def write_rtabmap(path: Path, shots: list[Shot]) -> Path:
    """rtabmap-export --images --poses: poses are the robot's, local_transform says where its camera is."""
    for name in ("rgb", "depth", "calib"):
        (path / f"rtabmap_{name}").mkdir()
    local = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 0.2], [0, 0, 0, 1.0]])
    lines = ["#timestamp x y z qx qy qz qw id"]
    for k, s in enumerate(shots):
        stamp = f"{s.time:.6f}"
        (path / f"rtabmap_rgb/{stamp}.jpg").write_bytes(s.jpeg)
        (path / f"rtabmap_depth/{stamp}.png").write_bytes(png16(s.millimetres))
        storage = cv2.FileStorage(str(path / f"rtabmap_calib/{stamp}.yaml"), cv2.FILE_STORAGE_WRITE)
        storage.write("camera_name", "camera")
        storage.write("image_width", CAMERA.width)
        storage.write("image_height", CAMERA.height)
        storage.write("camera_matrix", CAMERA.K)
        storage.write("distortion_coefficients", np.zeros((1, 5)))
        storage.write("local_transform", local[:3])
        storage.release()
        pose = pose_vector(s.T_world_camera @ np.linalg.inv(local))
        lines.append(f"{stamp} " + " ".join(f"{v:.9f}" for v in pose) + f" {k + 1}")
    (path / "rtabmap_poses.txt").write_text("\n".join(lines) + "\n")
    return path


def write_klg(path: Path, shots: list[Shot]) -> Path:
    data = [struct.pack("<i", len(shots))]
    for s in shots:
        depth = zlib.compress(s.millimetres.astype("<u2").tobytes())
        data += [struct.pack("<qii", round(s.time * 1e6), len(depth), len(s.jpeg)), depth, s.jpeg]
    (path / "room.klg").write_bytes(b"".join(data))
    return path / "room.klg"


def azure_calibration(
    color: Intrinsics = CAMERA, depth: Intrinsics = CAMERA, distortion: tuple[float, ...] = (0.0,) * 8,
    T_color_depth: np.ndarray | None = None,
) -> bytes:  # fmt: skip
    """calibration.json of cameras whose images are the whole sensor; distortion k1 k2 k3 k4 k5 k6 p1 p2."""
    T = np.eye(4) if T_color_depth is None else T_color_depth
    cameras = []
    for purpose, c, place in (("PhotoVideo", color, T), ("Depth", depth, np.eye(4))):
        *k, p1, p2 = distortion
        shares = [(c.cx + 0.5) / c.width, (c.cy + 0.5) / c.height, c.fx / c.width, c.fy / c.height]
        cameras.append(
            {
                "Purpose": f"CALIBRATION_CameraPurpose{purpose}",
                "Intrinsics": {
                    "ModelType": "CALIBRATION_LensDistortionModelBrownConrady", "ModelParameterCount": 14,
                    "ModelParameters": [*shares, *k, 0.0, 0.0, p2, p1],
                },
                "Rt": {"Rotation": place[:3, :3].ravel().tolist(), "Translation": place[:3, 3].tolist()},
            }
        )  # fmt: skip
    return json.dumps({"CalibrationInformation": {"Cameras": cameras}}).encode()


def write_azure(path: Path, shots: list[Shot], attached: bytes | None = None) -> Path:
    tracks = {
        "COLOR": ("ffv1", "bgr0", "rgb24", [s.rgb for s in shots]),
        "DEPTH": ("rawvideo", "gray16be", "gray16be", [s.millimetres for s in shots]),
        "IR": ("rawvideo", "gray16be", "gray16be", [s.millimetres // 2 for s in shots]),
    }
    write_film(path / "output.mkv", tracks, azure_calibration() if attached is None else attached)
    return path / "output.mkv"


def zipped(folder: Path, kind: str) -> Path:
    """An archive of a folder: zip, gztar."""
    return Path(
        shutil.make_archive(str(folder.parent / f"{folder.name}_packed"), kind, folder.parent, folder.name)
    )
