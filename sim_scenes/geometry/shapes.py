"""Triangle meshes of simple bodies, from which all furniture is assembled.

Every function returns a closed (unless said otherwise) `Shape` with outward faces. Lengths are metres,
z is up. Texture coordinates are metres too (a material says how many metres its texture spans), except
for `panel`, whose coordinates run from 0 to 1 over its front.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Vector = Sequence[float] | np.ndarray
Points = Sequence[Vector] | np.ndarray


@dataclass(frozen=True)
class Shape:
    """A triangle mesh: vertices (N, 3) [m], faces (F, 3) int, texture coordinates (N, 2)."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray

    def moved(self, xyz: Vector = (0, 0, 0), yaw: float = 0.0) -> "Shape":
        """Turned about the z axis by `yaw` [rad], then shifted by `xyz` [m]."""
        return Shape(self.vertices @ rotation_z(yaw).T + np.asarray(xyz, float), self.faces, self.uv)

    def turned(self, rotation: np.ndarray) -> "Shape":
        """Turned about the origin by a rotation matrix, shape (3, 3)."""
        return Shape(self.vertices @ rotation.T, self.faces, self.uv)

    def bounds(self) -> np.ndarray:
        """Lowest and highest corner [m], shape (2, 3)."""
        return np.array([self.vertices.min(0), self.vertices.max(0)])


def rotation_z(angle: float) -> np.ndarray:
    """Rotation matrix about z, shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_x(angle: float) -> np.ndarray:
    """Rotation matrix about x, shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def merged(shapes: Sequence[Shape]) -> Shape:
    """One mesh of several."""
    offsets = np.cumsum([0] + [len(s.vertices) for s in shapes[:-1]])
    return Shape(
        np.concatenate([s.vertices for s in shapes]),
        np.concatenate([s.faces + o for s, o in zip(shapes, offsets, strict=True)]),
        np.concatenate([s.uv for s in shapes]),
    )


def _projected_uv(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Metres along the two axes of the plane that `normal` is nearest to; v runs downwards on walls."""
    axis = int(np.argmax(np.abs(normal)))
    if axis == 2:
        return points[:, [0, 1]] * [1, -1]
    return points[:, [1, 2] if axis == 0 else [0, 2]] * [1, -1]


def polygons(faces: Sequence[np.ndarray]) -> Shape:
    """Flat convex polygons (each (n, 3), counter-clockwise from outside), not welded, box-projected uv."""
    vertices, triangles, uv, start = [], [], [], 0
    for face in faces:
        face = np.asarray(face, float)
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        vertices.append(face)
        uv.append(_projected_uv(face, normal))
        triangles += [(start, start + i, start + i + 1) for i in range(1, len(face) - 1)]
        start += len(face)
    return Shape(np.concatenate(vertices), np.array(triangles), np.concatenate(uv))


def box(size: Vector, at: Vector = (0, 0, 0), bevel: float = 0.0) -> Shape:
    """A box of full `size` whose BOTTOM centre is `at`, its edges chamfered by `bevel`.

    On posts and tall boards u runs upwards, so that wood's grain follows their length.
    """
    half = np.asarray(size, float) / 2
    centre = np.asarray(at, float) + [0, 0, half[2]]
    bevel = min(bevel, 0.45 * 2 * float(half.min()))
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1, 1):
            corner = np.zeros((4, 3))
            corner[:, axis] = side * half[axis]
            corner[:, u] = np.array([-1, 1, 1, -1]) * (half[u] - bevel)
            corner[:, v] = np.array([-1, -1, 1, 1]) * (half[v] - bevel)
            faces.append(corner if side > 0 else corner[::-1])
    if bevel > 0:
        faces += _chamfers(half, bevel)
    shape = polygons([face + centre for face in faces])
    post = half[2] > 3 * max(half[0], half[1])
    return Shape(shape.vertices, shape.faces, shape.uv[:, ::-1] * [-1, 1]) if post else shape


def _chamfers(half: np.ndarray, bevel: float) -> list[np.ndarray]:
    """The twelve edge strips and eight corner triangles of a chamfered box about the origin."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for su in (-1, 1):
            for sv in (-1, 1):
                strip = np.zeros((4, 3))
                strip[:, axis] = np.array([-1, 1, 1, -1]) * (half[axis] - bevel)
                strip[:, u] = su * (half[u] - np.array([0, 0, bevel, bevel]))
                strip[:, v] = sv * (half[v] - np.array([bevel, bevel, 0, 0]))
                faces.append(strip if su * sv < 0 else strip[::-1])
    for signs in np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).T.reshape(-1, 3):
        inner = half - bevel
        corner = np.array(
            [[half[0], inner[1], inner[2]], [inner[0], half[1], inner[2]], [inner[0], inner[1], half[2]]]
        )
        corner = corner * signs
        faces.append(corner if np.prod(signs) > 0 else corner[::-1])
    return [f if np.dot(np.cross(f[1] - f[0], f[2] - f[0]), f.mean(0)) > 0 else f[::-1] for f in faces]


def panel(width: float, height: float, thickness: float = 0.02) -> Shape:
    """An upright plate, bottom centre at the origin, front at -y with uv 0..1 (v = 0 at the top)."""
    plate = box((width, thickness, height))
    uv = np.stack([plate.vertices[:, 0] / width + 0.5, 1 - plate.vertices[:, 2] / height], 1)
    return Shape(plate.vertices, plate.faces, np.clip(uv, 0.002, 0.998))


def lathe(profile: Sequence[tuple[float, float]], at: Sequence[float] = (0, 0, 0), sides: int = 32) -> Shape:
    """A solid of revolution about z through `at`; `profile` = (radius, z) from bottom to top.

    Rings of positive radius at the ends are closed by flat caps. A sharp edge of the profile is kept by
    giving every segment its own vertices.
    """
    profile = [(float(r), float(z)) for r, z in profile]
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    widest = max(r for r, _ in profile)
    vertices, faces, uv, start, length = [], [], [], 0, 0.0
    closed = [(0.0, profile[0][1]), *profile, (0.0, profile[-1][1])]
    for (r0, z0), (r1, z1) in zip(closed[:-1], closed[1:], strict=True):
        if r0 == r1 and z0 == z1:
            continue
        step = float(np.hypot(r1 - r0, z1 - z0))
        for r, z, v in ((r0, z0, length), (r1, z1, length + step)):
            vertices.append(np.column_stack([ring * r, np.full(sides + 1, z)]))
            uv.append(np.column_stack([angle * widest, np.full(sides + 1, -v)]))
        low, high = start + np.arange(sides), start + sides + 1 + np.arange(sides)
        if r0 > 0:
            faces.append(np.column_stack([low, low + 1, high + 1]))
        if r1 > 0:
            faces.append(np.column_stack([low, high + 1, high]))
        start += 2 * (sides + 1)
        length += step
    return Shape(np.concatenate(vertices) + np.asarray(at, float), np.concatenate(faces), np.concatenate(uv))


def cylinder(radius: float, height: float, at: Sequence[float] = (0, 0, 0), sides: int = 32) -> Shape:
    """An upright cylinder, bottom centre at `at`."""
    return lathe([(radius, 0), (radius, height)], at, sides)


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles of a grid of rows x columns vertices, counter-clockwise when rows grow up, columns right."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def cushion(size: Vector, at: Vector = (0, 0, 0), softness: float = 0.5, rings: int = 16) -> Shape:
    """A soft box (superellipsoid) of full `size`, bottom centre at `at`; softness 0.1 boxy .. 1 ellipsoid.

    `rings` faces from pole to pole, twice as many around.
    """
    half = np.asarray(size, float) / 2
    latitude, longitude = (
        np.linspace(-np.pi / 2, np.pi / 2, rings + 1),
        np.linspace(-np.pi, np.pi, 2 * rings + 1),
    )
    lat, lon = np.meshgrid(latitude, longitude, indexing="ij")

    def power(x: np.ndarray) -> np.ndarray:
        x = np.where(
            np.abs(x) < 1e-9, 0.0, x
        )  # cos(pi / 2) is not 0, and a low power of it is a hole at the pole
        return np.sign(x) * np.abs(x) ** softness

    unit = np.stack(
        [
            power(np.cos(lat)) * power(np.cos(lon)),
            power(np.cos(lat)) * power(np.sin(lon)),
            power(np.sin(lat)),
        ],
        -1,
    )
    points = (unit * half).reshape(-1, 3)
    faces = _grid_faces(rings + 1, 2 * rings + 1)
    corner = points[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    uv = points[:, :2] * [1, -1] + np.stack([np.zeros(len(points)), -points[:, 2]], 1)
    return Shape(points + np.asarray(at, float) + [0, 0, half[2]], faces[area > 1e-10], uv)


def sheet(front: np.ndarray, thickness: float) -> Shape:
    """A closed cloth of a grid of points (rows upwards, columns rightwards seen from its front), shape (R, C, 3).

    The back lies `thickness` behind, against each vertex normal.
    """
    rows, columns = front.shape[:2]
    du, dv = np.gradient(front, axis=1), np.gradient(front, axis=0)
    normal = np.cross(du, dv)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    back = front - thickness * normal
    along = np.concatenate(
        [np.zeros((rows, 1)), np.cumsum(np.linalg.norm(np.diff(front, axis=1), axis=-1), 1)], 1
    )
    up = np.concatenate(
        [np.zeros((1, columns)), np.cumsum(np.linalg.norm(np.diff(front, axis=0), axis=-1), 0)], 0
    )
    uv = np.stack([along, -up], -1).reshape(-1, 2)
    faces = _grid_faces(rows, columns)
    index = np.arange(rows * columns).reshape(rows, columns)
    rim = np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])
    following, count = np.roll(rim, -1), rows * columns
    sides = [
        np.stack([rim, rim + count, following], 1),
        np.stack([following, rim + count, following + count], 1),
    ]
    points = np.concatenate([front.reshape(-1, 3), back.reshape(-1, 3)])
    return Shape(points, np.concatenate([faces, faces[:, ::-1] + count, *sides]), np.concatenate([uv, uv]))
