"""Every format that the recording of recording_shots.py is written in."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import format_exporters as formats
import ros_exporters as ros
from recording_shots import CAMERA, Shot, shots, through_jpeg

from dsmap.frame import Intrinsics


@dataclass(frozen=True)
class Case:
    """One way to write the recording."""

    reader: str
    write: Callable[[Path, list[Shot]], Path]
    jpeg: bool = False
    """Colour goes through JPEG (the same bytes are compared)."""
    units: float = 1000.0
    """Stored units of depth per metre."""
    begin: float | None = None
    """First stamp; None: as the recording's."""
    camera: Intrinsics = CAMERA
    has_poses: bool = True


ICL_CAMERA = Intrinsics(640, 480, 481.2, 480.0, 319.5, 239.5).scaled(96, 72)
KLG_CAMERA = Intrinsics(640, 480, 528.0, 528.0, 319.5, 239.5).scaled(96, 72)
CASES = {
    "ros1": Case("ros", ros.write_ros1),
    "ros1-compressed": Case("ros", ros.write_ros1_compressed, jpeg=True, has_poses=False),
    "ros2-db3": Case("ros", ros.write_ros2_db3),
    "ros2-db3-file": Case("ros", ros.write_ros2_db3_file),
    "ros2-mcap": Case("ros", ros.write_ros2_mcap),
    "ros2-mcap-file": Case("ros", ros.write_ros2_mcap_file, jpeg=True, has_poses=False),
    "realsense": Case("realsense", ros.write_realsense, has_poses=False),
    "scannet-sens": Case("scannet-sens", formats.write_sens, jpeg=True),
    "scannet": Case("scannet", formats.write_scannet, jpeg=True, begin=0.0),
    "replica": Case("replica", formats.write_replica, jpeg=True, units=6553.5, begin=0.0),
    "replica-nerf": Case("replica", formats.write_replica_of_nerf, begin=0.0),
    "eth3d": Case("tum", formats.write_eth3d, units=5000.0),
    "icl-nuim": Case("icl-nuim", formats.write_icl, units=5000.0, begin=0.0, camera=ICL_CAMERA),
    "sun3d": Case("sun3d", formats.write_sun3d, jpeg=True, begin=0.0),
    "bundlefusion": Case("bundlefusion", formats.write_bundlefusion, jpeg=True, begin=0.0),
    "transforms.json": Case("transforms.json", formats.write_nerfstudio, begin=0.0),
    "record3d": Case("record3d", formats.write_record3d, jpeg=True, units=1.0),
    "stray-scanner": Case("stray-scanner", formats.write_stray),
    "arkitscenes": Case("arkitscenes", formats.write_arkit),
    "rtabmap": Case("rtabmap", formats.write_rtabmap, jpeg=True),
    "klg": Case("klg", formats.write_klg, jpeg=True, camera=KLG_CAMERA, has_poses=False),
    "azure-kinect": Case("azure-kinect", formats.write_azure, begin=0.0, has_poses=False),
}
STAMP_TOLERANCE = {"sun3d": 2e-6, "arkitscenes": 6e-4, "azure-kinect": 6e-4}
"""Of formats whose files hold fewer digits [s]."""


def recorded(case: Case) -> list[Shot]:
    found = shots() if case.begin is None else shots(case.begin)
    return through_jpeg(found) if case.jpeg else found


def written(case: Case, folder: Path) -> Path:
    """The recording is written from the pixels before JPEG, which the exporters apply themselves."""
    folder.mkdir()
    return case.write(folder, shots())
