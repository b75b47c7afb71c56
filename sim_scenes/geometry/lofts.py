"""Bodies that boxes and turned profiles cannot make: lofts through rings, tubes along a line, prisms, hollow tubs.

Like `shapes`: closed meshes with outward faces, metres, z up, texture coordinates in metres.
"""

from collections.abc import Sequence

import numpy as np

from dsmap.sim_scenes.geometry.shapes import Points, Shape, Vector, polygons


def ring(size: Vector, at: Vector = (0, 0, 0), corner: float = 0.5, sides: int = 32) -> np.ndarray:
    """A level superellipse of full `size` (x, y) about `at`, counter-clockwise from above, shape (sides, 3).

    `corner` 1 is an ellipse, 0.3 a rounded rectangle.
    """
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False) + np.pi / sides
    c, s = np.cos(angle), np.sin(angle)
    points = np.zeros((sides, 3))
    points[:, 0] = np.sign(c) * np.abs(c) ** corner * size[0] / 2
    points[:, 1] = np.sign(s) * np.abs(s) ** corner * size[1] / 2
    return points + np.asarray(at, float)


def loft(rings: Sequence[np.ndarray], sharp: float = 0.8, caps: bool = True) -> Shape:
    """A skin over rings of equal count (each (n, 3), counter-clockwise seen from the far end), both ends capped.

    Without `caps` the last ring is to be the first one again (a hoop).

    Rings that go down again inside the first make a vessel. Where two strips meet at more than about
    acos(sharp) the edge is kept sharp by giving each strip its own vertices.
    """
    count = len(rings[0])
    closed = np.stack([np.vstack([r, r[:1]]) for r in np.asarray(rings, float)])
    around = np.linalg.norm(np.diff(closed, axis=1), axis=-1).mean(0)
    across = np.concatenate([[0], np.cumsum(around)])
    vertices, faces, uv, start, length = [], [], [], 0, 0.0
    for low, high in zip(closed[:-1], closed[1:], strict=True):
        step = float(np.linalg.norm(high - low, axis=1).mean())
        if step < 1e-6:
            continue
        vertices += [low, high]
        uv += [np.column_stack([across, np.full(count + 1, -v)]) for v in (length, length + step)]
        a = start + np.arange(count)
        b = a + count + 1
        faces += [np.column_stack([a, a + 1, b + 1]), np.column_stack([a, b + 1, b])]
        start, length = start + 2 * (count + 1), length + step
    for points, outward in ((closed[0, :-1], False), (closed[-1, :-1], True)) if caps else ():
        if np.ptp(points, axis=0).max() < 1e-6:
            continue
        centre = points.mean(0)
        vertices += [points, centre[None]]
        flat = np.vstack([points, centre])
        uv.append(np.column_stack([flat[:, 0], -flat[:, 1]]))
        a = start + np.arange(count)
        b = start + (np.arange(count) + 1) % count
        tip = np.full(count, start + count)
        faces.append(np.column_stack([a, b, tip] if outward else [b, a, tip]))
        start += count + 1
    shape = Shape(np.concatenate(vertices), np.concatenate(faces), np.concatenate(uv))
    return _without_slivers(_welded(shape, sharp))


def _welded(shape: Shape, sharp: float) -> Shape:
    """Give equal positions one vertex where the faces about them are nearly level, so that shading is smooth."""
    corner = shape.vertices[shape.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    at_vertex = np.zeros_like(shape.vertices)
    for k in range(3):
        np.add.at(at_vertex, shape.faces[:, k], normal)
    at_vertex /= np.maximum(np.linalg.norm(at_vertex, axis=1, keepdims=True), 1e-12)
    key = np.round(shape.vertices * 1e5).astype(np.int64)
    _, same = np.unique(key, axis=0, return_inverse=True)
    same = same.reshape(-1)
    order = np.argsort(same, kind="stable")
    target = np.arange(len(same))
    first = order[0]
    for index in order[1:]:
        if same[index] != same[first]:
            first = index
        elif at_vertex[index] @ at_vertex[first] > sharp and np.allclose(
            shape.uv[index], shape.uv[first], atol=1e-4
        ):
            target[index] = first
    return Shape(shape.vertices, target[shape.faces], shape.uv)


def _without_slivers(shape: Shape) -> Shape:
    """Drop faces without area and vertices that no face uses."""
    corner = shape.vertices[shape.faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    faces = shape.faces[area > 1e-10]
    used, faces = np.unique(faces, return_inverse=True)
    return Shape(shape.vertices[used], faces.reshape(-1, 3), shape.uv[used])


def tube(path: Points, radius: float | Vector, sides: int = 10) -> Shape:
    """A round bar along a line of points, shape (n, 3), of one radius or one a point [m]."""
    points = np.asarray(path, float)
    radii = np.broadcast_to(np.asarray(radius, float), len(points))
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], [0.0, 0.0, 1.0] if abs(along[0, 2]) < 0.9 else [1.0, 0.0, 0.0])
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[:, None]
    rings = []
    for point, direction, r in zip(points, along, radii, strict=True):
        side = side - (side @ direction) * direction
        side /= np.linalg.norm(side)
        other = np.cross(direction, side)
        rings.append(point + r * (np.cos(angle) * side + np.sin(angle) * other))
    skin = loft(rings, sharp=0.5)
    return Shape(skin.vertices, skin.faces, skin.uv[:, ::-1])


def bow(start: Vector, middle: Vector, end: Vector, steps: int = 9) -> np.ndarray:
    """Points of a quadratic Bezier curve that passes near `middle`, shape (steps, 3)."""
    t = np.linspace(0, 1, steps)[:, None]
    a, b, c = (np.asarray(p, float) for p in (start, middle, end))
    return (1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c


def prism(outline: Points, depth: float) -> Shape:
    """A convex outline (n, 2) in the x-z plane, counter-clockwise seen from -y, `depth` thick about y = 0."""
    flat = np.asarray(outline, float)
    front = np.column_stack([flat[:, 0], np.full(len(flat), -depth / 2), flat[:, 1]])
    back = front + [0, depth, 0]
    sides = [
        np.stack([front[i], back[i], back[(i + 1) % len(flat)], front[(i + 1) % len(flat)]])
        for i in range(len(flat))
    ]
    return polygons([front, back[::-1], *sides])


def tub(size: Vector, wall: float, floor: float, at: Vector = (0, 0, 0), corner: float = 0.3) -> Shape:
    """A hollow vessel, open above: outer `size`, wall thickness, floor thickness [m]; bottom centre at `at`."""
    w, d, h = (float(v) for v in size)
    x, y, z = (float(v) for v in at)
    inner = (w - 2 * wall, d - 2 * wall)
    return loft(
        [
            ring((w * 0.9, d * 0.9), (x, y, z), corner),
            ring((w, d), (x, y, z + h), corner),
            ring(inner, (x, y, z + h), corner),
            ring((inner[0] * 0.92, inner[1] * 0.88), (x, y, z + floor + 0.25 * (h - floor)), corner),
            ring((inner[0] * 0.8, inner[1] * 0.7), (x, y, z + floor), corner),
        ]
    )


def plate_with_hole(
    size: Vector, hole: Vector, at: Vector, hole_at: Vector = (0, 0), corner: float = 0.02
) -> Shape:
    """A board of `size` (w, d, thickness), bottom centre `at`, with a hole (w, d) of `ring`'s `corner` in it.

    `hole_at` is the hole's middle from the board's middle.
    """
    thick = float(size[2])
    inner = [ring(hole, (hole_at[0], hole_at[1], z), corner, 64) for z in (thick, 0.0)]
    outer = [ring(size[:2], (0, 0, z), 0.004, 64) for z in (0.0, thick)]
    return loft([*outer, *inner, outer[0]], caps=False).moved(at)


def crumpled(
    rng: np.random.Generator, size: Vector, at: Vector = (0, 0, 0), depth: float = 0.25, rows: int = 14
) -> Shape:
    """A heap of cloth: a flattened lump with folds, bottom centre at `at`, flat underneath."""
    w, d, h = (float(v) for v in size)
    angle = np.linspace(0, 2 * np.pi, 3 * rows, endpoint=False)
    waves = [(int(rng.integers(3, 9)), rng.uniform(0, 6.3), rng.uniform(0.3, 1.0)) for _ in range(4)]
    rings = [ring((0.0, 0.0), (0, 0, 0), 1.0, 3 * rows)]
    for t in np.linspace(0.0, 1.0, rows):
        radius = np.cos(t * np.pi / 2) ** 0.6 if t < 1 else 0.0
        wrinkle = sum(a * np.sin(n * angle + p + 2.5 * t * n) for n, p, a in waves) / 4
        level = np.full_like(angle, np.sin(t * np.pi / 2) * h)
        lift = 1 + depth * wrinkle * min(1.0, 4 * t)
        spread = radius * (1 + depth * wrinkle)
        rings.append(
            np.column_stack([np.cos(angle) * spread * w / 2, np.sin(angle) * spread * d / 2, level * lift])
        )
    tip = rings[-1].mean(0)
    rings[-1] = np.broadcast_to(tip, rings[-1].shape)
    return loft(rings, sharp=0.0).moved(at)
