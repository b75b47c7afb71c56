"""A camera frame, its intrinsics and the pixel-centre convention that all of dsmap uses.

Convention: INTEGER pixel centres. The centre of the top-left pixel has the image coordinates (0, 0), so
`x = fx * X / Z + cx` rounds to the pixel's index. A file that says `pixel_center: half` (centres at .5,
as renderers do) is converted on reading by subtracting 0.5 from cx and cy. Camera axes: x right, y down,
z forward; depth is planar z [m].
"""

from dataclasses import dataclass, replace

import numpy as np

from dsmap.errors import InputError


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera, integer pixel centres.

    `distortion`: None, or coefficients in OpenCV's order: 5 of radtan (k1, k2, p1, p2, k3), 8 of rational (and k4,
    k5, k6), 4 of fisheye (k1, k2, k3, k4); see `dsmap.lens`.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] | None = None

    @property
    def K(self) -> np.ndarray:
        """Camera matrix [px], shape (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)

    def scaled(self, width: int, height: int) -> "Intrinsics":
        """The same camera at another image size: x' = (x + 0.5) * s - 0.5 for integer pixel centres."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )


def orthonormal(T: np.ndarray) -> np.ndarray:
    """The rigid transform nearest to T, shape (4, 4): undoes rounded files and the drift of many multiplications."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    out = T.copy()
    out[:3, :3] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return out


@dataclass
class Frame:
    """One colour image with the depth image registered to it, and whatever ground truth there is."""

    index: int
    """Position in the sequence after association (and `--start/--stride`: the index in the recording)."""
    time: float
    """Colour time stamp [s]."""
    rgb: np.ndarray
    """Colour, uint8, shape (H, W, 3), RGB order."""
    depth: np.ndarray
    """Planar depth [m], float32, shape (H, W); 0 where there is none."""
    T_world_camera: np.ndarray | None = None
    """Given pose (ground truth or pseudo ground truth), float64, shape (4, 4)."""
    label: np.ndarray | None = None
    """Ground-truth class ids, uint8, shape (H, W); None where this frame has no labels."""
    instance: np.ndarray | None = None
    """Ground-truth instance ids, uint16, shape (H, W)."""
    depth_time: float | None = None
    """Stamp of the depth image [s], which is the time of the pose; None: that of the colour."""

    @property
    def pose_time(self) -> float:
        """When the camera was at the frame's pose [s]."""
        return self.time if self.depth_time is None else self.depth_time

    def check_size(self, camera: Intrinsics) -> None:
        """Raises InputError unless both images have the camera's size."""
        for name, image in (("depth", self.depth), ("colour", self.rgb)):
            if image.shape[:2] != (camera.height, camera.width):
                found = f"{image.shape[1]}x{image.shape[0]}; expected {camera.width}x{camera.height}"
                raise InputError(f"frame {self.index}: {name} is {found}, the camera's size")


@dataclass(frozen=True)
class FrameGeometry:
    """What a frame's depth and gravity say about every pixel."""

    channels: np.ndarray
    """float32, shape (H, W, 4): inverse depth, cosine of the normal to up, height above the floor, validity, scaled as
    `dsmap.kernels.geometry` says; 0 where there is no depth."""
    up: np.ndarray
    """Unit vector in the camera's frame, shape (3,)."""
    floor_height: float
    """Where the floor lies along up, seen from the camera [m]; negative below it."""
    confidence: float = 1.0
    """How much speaks for `up`, 0 to 1 (see `dsmap.gravity.Up`)."""
