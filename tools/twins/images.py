"""Slow, readable NumPy twins of the preprocessing and tracking kernels (the map's are in reference_map.py)."""

import numpy as np


def rays(camera) -> np.ndarray:
    """Viewing rays with z = 1, shape (H, W, 3)."""
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)


def bilateral(depth: np.ndarray, sigma_space: float, sigma_range: float, radius: int = 3) -> np.ndarray:
    """Bilateral filter over a disc, reflected at the border; 0 stays 0."""
    height, width = depth.shape
    padded = np.pad(depth.astype(np.float64), radius, mode="reflect")
    out = np.zeros((height, width))
    for y, x in np.argwhere(depth > 0):
        total = norm = 0.0
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                if dx * dx + dy * dy > radius * radius:
                    continue
                value = padded[y + radius + dy, x + radius + dx]
                gap = value - depth[y, x]
                w = np.exp(-(dx * dx + dy * dy) / (2 * sigma_space**2) - gap**2 / (2 * sigma_range**2))
                total, norm = total + w * value, norm + w
        out[y, x] = total / norm
    return out


def _difference(before, centre, after):
    if before[2] > 0 and after[2] > 0:
        if abs(before[2] + after[2] - 2 * centre[2]) > 0.01 + 0.015 * centre[2]:
            ahead_is_smoother = abs(after[2] - centre[2]) < abs(centre[2] - before[2])
            return after - centre if ahead_is_smoother else centre - before
        return after - before
    if after[2] > 0:
        return after - centre
    if before[2] > 0:
        return centre - before
    return np.zeros(3)


def _is_edge(depth, y, x):
    z = depth[y, x]
    gate = 0.01 + 0.015 * z
    pairs = ((depth[y, x - 1], depth[y, x + 1]), (depth[y - 1, x], depth[y + 1, x]))
    for a, b in pairs:
        if a > 0 and b > 0 and abs(a + b - 2 * z) > gate:
            return True
    return any(v > 0 and abs(v - z) > 3 * gate for pair in pairs for v in pair)


def surface(camera, depth: np.ndarray) -> tuple[np.ndarray, ...]:
    """Vertex, normal, radius and edge map of a depth map."""
    vertex = depth[..., None].astype(np.float64) * rays(camera)
    normal, radius = np.zeros_like(vertex), np.zeros(depth.shape)
    edge = np.zeros(depth.shape, dtype=np.uint8)
    for y, x in np.argwhere(depth > 0):
        if not (0 < x < camera.width - 1 and 0 < y < camera.height - 1):
            continue
        k = int(np.clip(int(2.5 * depth[y, x] * camera.fx / 525 + 0.5), 1, 10))
        west, east = max(x - k, 0), min(x + k, camera.width - 1)
        north, south = max(y - k, 0), min(y + k, camera.height - 1)
        dx = _difference(vertex[y, west], vertex[y, x], vertex[y, east])
        dy = _difference(vertex[north, x], vertex[y, x], vertex[south, x])
        n = np.cross(dy, dx)
        if np.linalg.norm(n) > 0:
            normal[y, x] = n / np.linalg.norm(n)
        edge[y, x] = _is_edge(depth, y, x)
        slant = min(1 / max(-normal[y, x, 2], 0.1), 2.0)
        radius[y, x] = np.sqrt(2) * depth[y, x] / camera.fx * slant
    return vertex, normal, radius, edge


def geometry_channels(vertex, normal, up, floor_height) -> np.ndarray:
    """Inverse depth, cosine to up, height above the floor and validity of a frame's points, shape (H, W, 4)."""
    out = np.zeros((*vertex.shape[:2], 4))
    for y, x in np.argwhere(vertex[..., 2] > 0):
        height = np.clip(vertex[y, x] @ up - floor_height, -0.3, 3.5)
        inverse_depth = 1 / max(vertex[y, x, 2], 0.3)
        out[y, x] = (inverse_depth - 0.45) / 0.25, normal[y, x] @ up, (height - 1.0) / 0.8, 1
    return out


def half_surface(vertex, normal, intensity) -> tuple[np.ndarray, ...]:
    """Next pyramid level: means over 2x2 blocks of what lies within 5 % of the nearest."""
    shape = (vertex.shape[0] // 2, vertex.shape[1] // 2)
    v_out, n_out, i_out = np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape)
    for y in range(shape[0]):
        for x in range(shape[1]):
            block = (slice(2 * y, 2 * y + 2), slice(2 * x, 2 * x + 2))
            z = vertex[block][..., 2]
            if not (z > 0).any():
                continue
            use = (z > 0) & (z < z[z > 0].min() * 1.05)
            v_out[y, x] = vertex[block][use].mean(axis=0)
            n = normal[block][use].sum(axis=0)
            n_out[y, x] = n / np.linalg.norm(n) if np.linalg.norm(n) > 0 else 0
            i_out[y, x] = intensity[block][use].mean()
    return v_out, n_out, i_out


def gradient(intensity: np.ndarray, vertex: np.ndarray | None = None) -> np.ndarray:
    """Sobel sums divided by 8, zero on the border and next to holes, shape (H, W, 2)."""
    out = np.zeros((*intensity.shape, 2))
    kernel = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
    for y in range(1, intensity.shape[0] - 1):
        for x in range(1, intensity.shape[1] - 1):
            block = (slice(y - 1, y + 2), slice(x - 1, x + 2))
            if vertex is not None and (vertex[block][..., 2] <= 0).any():
                continue
            out[y, x] = (kernel * intensity[block]).sum(), (kernel.T * intensity[block]).sum()
    return out


def bilinear(image: np.ndarray, u: float, v: float) -> np.ndarray | None:
    """Sample at image coordinates (u, v); None outside."""
    x, y = int(np.floor(u)), int(np.floor(v))
    if x < 0 or y < 0 or x + 1 >= image.shape[1] or y + 1 >= image.shape[0]:
        return None
    a, b = u - x, v - y
    top = (1 - a) * image[y, x] + a * image[y, x + 1]
    return (1 - b) * top + b * ((1 - a) * image[y + 1, x] + a * image[y + 1, x + 1])


def _huber(r: float, k: float) -> float:
    return k / abs(r) if k > 0 and abs(r) > k else 1.0


def _image_jacobian(camera, g, p) -> np.ndarray:
    """Row of d intensity / d twist for the intensity gradient g at the projection of p."""
    d_pi = np.array(
        [
            [camera.fx / p[2], 0, -camera.fx * p[0] / p[2] ** 2],
            [0, camera.fy / p[2], -camera.fy * p[1] / p[2] ** 2],
        ]
    )
    d = g @ d_pi
    return np.concatenate([d, np.cross(p, d)])


def joint_rows(camera, T, gates, frame, model) -> tuple[list, list]:
    """All rows (J, r, weight) of Eq. 1 and of Eq. 2."""
    vertex, normal, intensity = frame
    m_vertex, m_normal, m_intensity, m_gradient = model
    icp, rgb = [], []
    for y in range(0, camera.height, gates.stride):
        for x in range(0, camera.width, gates.stride):
            if vertex[y, x, 2] <= 0:
                continue
            p = T[:3, :3] @ vertex[y, x] + T[:3, 3]
            if p[2] <= 0:
                continue
            u, v = camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy
            px, py = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
            if not (0 <= px < camera.width and 0 <= py < camera.height):
                continue
            gap = m_vertex[py, px] - p
            if m_vertex[py, px, 2] <= 0 or np.linalg.norm(gap) > gates.max_distance:
                continue
            n = m_normal[py, px]
            if (T[:3, :3] @ normal[y, x]) @ n > gates.min_cosine:
                r = gap @ n
                noise = 1 / (1 + gates.noise_z * vertex[y, x, 2] ** 2)
                icp.append((np.concatenate([n, np.cross(p, n)]), r, noise**2 * _huber(r, gates.huber_icp)))
            g, sample = bilinear(m_gradient, u, v), bilinear(m_intensity, u, v)
            if g is None or sample is None or np.linalg.norm(g) < gates.min_gradient:
                continue
            r = gates.gain * intensity[y, x] - sample
            if abs(r) <= gates.max_intensity:
                rgb.append((_image_jacobian(camera, g, p), r, _huber(r, gates.huber_rgb)))
    return icp, rgb


def rotation_rows(camera, R, intensity, last_intensity, last_gradient) -> list:
    """All rows (J, r, weight) of rotation-only alignment."""
    rows = []
    directions = rays(camera)
    for y in range(camera.height):
        for x in range(camera.width):
            q = R @ directions[y, x]
            if q[2] <= 0.1:
                continue
            u, v = camera.fx * q[0] / q[2] + camera.cx, camera.fy * q[1] / q[2] + camera.cy
            sample = bilinear(last_intensity, u, v)
            if sample is None:
                continue
            r = intensity[y, x] - sample
            rows.append((_image_jacobian(camera, bilinear(last_gradient, u, v), q)[3:], r, _huber(r, 0.1)))
    return rows


def normal_equations(rows: list) -> tuple[np.ndarray, np.ndarray, float, int]:
    """J^T W J, J^T W r, weighted sum of squares, count."""
    n = len(rows[0][0])
    A, b, cost = np.zeros((n, n)), np.zeros(n), 0.0
    for J, r, w in rows:
        A += w * np.outer(J, J)
        b += w * J * r
        cost += w * r * r
    return A, b, cost, len(rows)


def global_shutter(camera, maps: dict, twist: np.ndarray, readout: float) -> dict:
    """Twin of `dsmap.kernels.shutter.global_shutter`: maps by name, each pixel by itself, exp(xi^ t) in full."""
    from dsmap.fusion.lie import exp_se3

    height, width = maps["vertex"].shape[:2]
    out = {name: np.zeros_like(values) for name, values in maps.items()}

    def at(row: int, sign: float) -> np.ndarray:
        return exp_se3(sign * twist * (row - (height - 1) / 2) * readout / (height - 1))

    all_rays = rays(camera)
    for y, x in np.ndindex(height, width):
        middle = min(x - x % 8 + 4, width - 1)  # neighbours share the answer of one of them
        row, column = y, middle
        for _ in range(2):
            T = at(row, -1)
            q = T[:3, :3] @ (all_rays[y, middle] * (maps["vertex"][row, column, 2] or 10.0)) + T[:3, 3]
            column = int(np.clip(np.floor(camera.fx * q[0] / q[2] + camera.cx + 0.5), 0, width - 1))
            row = int(np.clip(np.floor(camera.fy * q[1] / q[2] + camera.cy + 0.5), 0, height - 1))
        column = int(np.clip(x + column - middle, 0, width - 1))
        for name in ("intensity", "radius", "colour", "edge"):
            out[name][y, x] = maps[name][row, column]
        T, p = at(row, 1), maps["vertex"][row, column]
        if p[2] > 0:
            p, n = T[:3, :3] @ p + T[:3, 3], T[:3, :3] @ maps["normal"][row, column]
            u = camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy
            if max(abs(u[0] - x), abs(u[1] - y)) <= 1.5:
                out["vertex"][y, x], out["normal"][y, x], out["depth"][y, x] = p, n, p[2]
    return out
