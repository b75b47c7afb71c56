"""The peer of `dsmap bench`: Open3D's dense SLAM (t.pipelines.slam) on the CPU, on the same frames."""

import subprocess
import sys
from collections.abc import Sequence

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.evaluate.timing import Timing, time_steps

_VOXEL_M = 3 / 512
BLOCK_RESOLUTION = 16
BLOCK_COUNT = 40_000
TRUNCATION_VOXELS = 8
DEPTH_MIN_M = 0.1
DEPTH_DIFFERENCE_M = 0.07
"""Parameters of Open3D's own dense SLAM example, with a voxel of 3 m / 512."""


def check_open3d() -> None:
    """Make sure that Open3D can be imported, in a process of its own.

    Raises:
        InputError: it is not installed, or a system library is missing.
    """
    probe = subprocess.run([sys.executable, "-c", "import open3d"], capture_output=True, text=True)
    if probe.returncode == 0:
        return
    reason = (
        probe.stderr.strip().splitlines()[-1] if probe.stderr.strip() else f"exit code {probe.returncode}"
    )
    raise InputError(
        f"--peer open3d: Open3D cannot be imported ({reason}); it needs `pip install 'dsmap[bench]'` and the "
        "system libraries of `apt-get install libusb-1.0-0 libgomp1`"
    )


def time_open3d(
    frames: Sequence[Frame], intrinsics: Intrinsics, depth_scale: float, depth_max: float
) -> Timing:
    """Run Open3D's dense SLAM: frame-to-model tracking, TSDF integration, ray casting; time every frame."""
    import open3d as o3d

    device = o3d.core.Device("CPU:0")
    slam = o3d.t.pipelines.slam
    K = o3d.core.Tensor.from_numpy(intrinsics.K)
    pose = o3d.core.Tensor.from_numpy(np.eye(4))
    model = slam.Model(_VOXEL_M, BLOCK_RESOLUTION, BLOCK_COUNT, pose, device)
    current = slam.Frame(intrinsics.height, intrinsics.width, K, device)
    rendered = slam.Frame(intrinsics.height, intrinsics.width, K, device)
    images = [_images(o3d, frame, depth_scale) for frame in frames]
    count = 0

    def step(colour_depth: tuple) -> tuple[np.ndarray, bool]:
        nonlocal pose, count
        tracked = True
        current.set_data_from_image("color", colour_depth[0])
        current.set_data_from_image("depth", colour_depth[1])
        if count > 0:
            try:
                result = model.track_frame_to_model(
                    current, rendered, depth_scale, depth_max, DEPTH_DIFFERENCE_M
                )
                pose = pose @ result.transformation
            except RuntimeError:  # raised where the normal equations are singular
                tracked = False
        model.update_frame_pose(count, pose)
        if tracked:
            model.integrate(current, depth_scale, depth_max, TRUNCATION_VOXELS)
        model.synthesize_model_frame(rendered, depth_scale, DEPTH_MIN_M, depth_max, TRUNCATION_VOXELS, False)
        count += 1
        return pose.numpy().copy(), tracked

    return time_steps(images, step)


def _images(o3d, frame: Frame, depth_scale: float) -> tuple:
    """Colour and depth as Open3D takes them; depth in the recording's own 16-bit units."""
    depth = np.rint(frame.depth * depth_scale).clip(0, 65535).astype(np.uint16)
    tensors = (np.ascontiguousarray(frame.rgb), np.ascontiguousarray(depth))
    return tuple(o3d.t.geometry.Image(o3d.core.Tensor.from_numpy(array)) for array in tensors)
