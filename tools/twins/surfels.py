"""Slow, readable NumPy twins of the surfel-map kernels. `s` is `SurfelMap.numpy()`, copied and in float64."""

import numpy as np

from dsmap.tools.twins.images import rays


def arrays(surfels) -> dict[str, np.ndarray]:
    """Copies of a map's arrays, floats in double precision."""
    copies = {name: value.copy() for name, value in surfels.numpy().items()}
    return {name: v.astype(np.float64) if v.dtype == np.float32 else v for name, v in copies.items()}


def into_camera(T_world_camera, s) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals of surfels in the camera frame."""
    R, t = T_world_camera[:3, :3], T_world_camera[:3, 3]
    return (s["position"] - t) @ R, s["normal"] @ R


def project(camera, p) -> tuple[float, float]:
    return camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy


def pixel(camera, p):
    """(y, x) of the pixel that a point projects to, None outside the image."""
    if p[2] <= 0:
        return None
    x, y = (int(np.floor(v + 0.5)) for v in project(camera, p))
    return (y, x) if 0 <= x < camera.width and 0 <= y < camera.height else None


def neighbours(camera, y: int, x: int):
    """The 3x3 neighbourhood of a pixel inside the image, row by row."""
    for yy in range(max(y - 1, 0), min(y + 2, camera.height)):
        for xx in range(max(x - 1, 0), min(x + 2, camera.width)):
            yield yy, xx


def _hit(p, n, view):
    """Depth at which a ray meets a surfel's plane, and how far from its centre; None if it faces away."""
    if n @ view >= 0:
        return None
    z = (n @ p) / (n @ view)
    return z, np.linalg.norm(z * view - p)


def render_index(s, camera, T, *, max_depth, min_weight=0.0, stable_weight=0.0, t_min=0, t_max=2**31 - 1,
                 penalty=0.05, resolution=0.0):  # fmt: skip
    """Index map, int, shape (H, W)."""
    position, normal = into_camera(T, s)
    view = rays(camera)

    def rank(i, z):
        return z + penalty + _thickness(z) if s["weight"][i] < stable_weight else z

    takes_part = (
        (s["weight"] > 0)
        & (s["weight"] >= min_weight)
        & (t_min <= s["t_updated"])
        & (s["t_updated"] <= t_max)
    )
    asked = _front_surfels(s, camera, position, normal, takes_part, rank, max_depth, resolution)
    index = np.full((camera.height, camera.width), -1)
    for y, x in np.ndindex(index.shape):
        around = [(at, asked[at]) for at in neighbours(camera, y, x) if at in asked]
        if not around:
            continue
        front = min(depth for _, (depth, _) in around)
        if (y, x) in asked and asked[y, x][0] <= front + _thickness(front):
            index[y, x] = asked[y, x][1]
            continue
        best = (-1, 0.0, 0.0)
        around.sort(key=lambda entry: abs(entry[0][0] - y) + abs(entry[0][1] - x))  # stable: row by row
        for at, (_, i) in around:
            corner = abs(at[0] - y) + abs(at[1] - x) == 2
            if corner and best[0] >= 0 and best[1] <= front + _thickness(front):
                continue
            hit = _hit(position[i], normal[i], view[y, x])
            if hit is None or (at != (y, x) and (hit[1] > s["radius"][i] or hit[0] > max_depth)):
                continue
            depth, off, slack = rank(i, hit[0]), hit[1], _thickness(best[1])
            nearer = depth < best[1] + slack and off < best[2]
            if best[0] < 0 or depth < best[1] - slack or nearer:
                best = (i, depth, off)
        index[y, x] = best[0]
    return index


def _thickness(z):
    """Depths that differ by less are one surface."""
    return 0.01 + 0.005 * z * z


def _front_surfels(s, camera, position, normal, takes_part, rank, max_depth, resolution):
    """By pixel: the least rank of the surfels that ask for it, and that surfel."""
    view, largest = rays(camera), 16 if resolution > 0 else 3
    asked: dict[tuple[int, int], tuple[float, int]] = {}
    for i, (p, n, r) in enumerate(zip(position, normal, s["radius"], strict=True)):
        if not takes_part[i] or not 2 * r < p[2] <= max_depth or n @ p >= 0:
            continue
        u, v = project(camera, p)
        cos = -(n @ p) / np.linalg.norm(p)
        asks = [(at, p[2]) for at in [pixel(camera, p)] if at]
        whole_from = 1.4 if resolution * camera.fx > 1.4 * p[2] else 2.2
        if (
            not asks or camera.fx * r * cos / p[2] >= whole_from
        ):  # seen from near, or from outside: the whole disc
            dx, dy = min(camera.fx * r / p[2], largest), min(camera.fy * r / p[2], largest)
            box = [
                (y, x)
                for y in range(max(int(np.ceil(v - dy)), 0), min(int(v + dy), camera.height - 1) + 1)
                for x in range(max(int(np.ceil(u - dx)), 0), min(int(u + dx), camera.width - 1) + 1)
            ]
            hits = [(at, _hit(p, n, view[at])) for at in box]
            back = _thickness(p[2]) / r**2 if resolution > 0 else 0.0  # rims of discs that overlap
            asks = [(at, h[0] + back * h[1] ** 2) for at, h in hits if h and h[1] <= r and h[0] <= max_depth]
        for at, depth in asks:
            asked[at] = min(asked.get(at, (np.inf, -1)), (rank(i, depth), i))
    return asked


def predict_model(s, camera, T, index) -> dict[str, np.ndarray]:
    """ModelMaps of an index map."""
    position, normal = into_camera(T, s)
    view, seen = rays(camera), index >= 0
    i = index[seen]
    maps = {name: np.zeros((*index.shape, 3)) for name in ("vertex", "normal", "colour")}
    maps["time"] = np.full(index.shape, -1)
    depth = (normal[i] * position[i]).sum(1) / (normal[i] * view[seen]).sum(1)
    maps["vertex"][seen] = depth[:, None] * view[seen]
    maps["normal"][seen], maps["colour"][seen] = normal[i], s["colour"][i]
    maps["time"][seen] = s["t_updated"][i]
    return maps


def associate_surfels(
    s, camera, T, frame, *, max_ray_distance=0.05, max_ray_distance_z2=0.0, max_angle=0.5, t_min=0
):
    """Match map, int, shape (H, W); `frame` holds NumPy maps by their FrameMaps name."""
    position, normal = into_camera(T, s)
    best: dict[tuple[int, int], tuple[bool, float, int]] = {}
    for i, (p, n) in enumerate(zip(position, normal, strict=True)):
        at = pixel(camera, p)
        if at is None or s["weight"][i] <= 0 or s["t_updated"][i] < t_min or frame["edge"][at]:
            continue
        v = frame["vertex"][at].astype(np.float64)
        ray = rays(camera)[at] / np.linalg.norm(rays(camera)[at])
        gate = max(max_ray_distance, max_ray_distance_z2 * v[2] ** 2)
        cos_angle = frame["normal"][at] @ n
        if v[2] <= 0 or abs((p - v) @ ray) >= gate or cos_angle <= 0:
            continue
        other = cos_angle <= np.cos(max_angle)
        best[at] = min(best.get(at, (True, np.inf, -1)), (other, float(np.linalg.norm(np.cross(p, ray))), i))
    match = np.full((camera.height, camera.width), -1)
    for at, (other, _, i) in best.items():
        match[at] = -2 if other else i
    return match


def sample_weight(camera, y: int, x: int) -> float:
    """exp(-gamma^2 / (2 0.6^2)), gamma = 1 at the image's corners."""
    centre = np.array([camera.height - 1, camera.width - 1]) / 2
    gamma = np.linalg.norm(np.array([y, x]) - centre) / np.linalg.norm(centre)
    return float(np.exp(-(gamma**2) / (2 * 0.6**2)))


def fuse_frame(s, camera, T, frame, match, *, time, max_weight=np.inf) -> dict[str, np.ndarray]:
    """The surfels after fusing a frame; new ones at the end, in image order."""
    R, t = T[:3, :3], T[:3, 3]
    before, _ = into_camera(T, s)
    s = {name: value.copy() for name, value in s.items()}
    new = []
    for at in np.ndindex(match.shape):
        y, x = at
        v, n = frame["vertex"][at].astype(np.float64), frame["normal"][at].astype(np.float64)
        a, i = sample_weight(camera, y, x), match[at]
        if i >= 0:
            w = s["weight"][i]
            if frame["radius"][at] < 1.5 * s["radius"][i]:
                mean = {
                    "position": R @ v + t,
                    "normal": R @ n,
                    "colour": frame["colour"][at],
                    "radius": frame["radius"][at],
                }
                for name, value in mean.items():
                    s[name][i] = (w * s[name][i] + a * value) / (w + a)
                s["normal"][i] /= np.linalg.norm(s["normal"][i])
            s["weight"][i], s["t_updated"][i] = min(w + a, max_weight), time
        elif i == -1 and v[2] > 0 and not frame["edge"][at] and n.any():
            around = [match[b] for b in neighbours(camera, y, x) if match[b] >= 0]
            offs = [before[j] - v - n * (n @ (before[j] - v)) for j in around]
            if not any(np.linalg.norm(off) < v[2] / camera.fx for off in offs):
                row = {"position": R @ v + t, "normal": R @ n, "colour": frame["colour"][at], "weight": a}
                row |= {"radius": frame["radius"][at], "t_created": time, "t_updated": time}
                new.append(row | {"label": 0, "observations": 0.0, "evidence": np.zeros(13), "segment": 0})
    if not new:
        return s
    return {name: np.concatenate([s[name], [row[name] for row in new]]) for name in s}


def find_uncovered(camera, T, frame, match, resolution, view=None) -> np.ndarray:
    """Pixels that become surfels of a map with a finest resolution, bool, shape (H, W).

    view: (camera, T_world_camera, vertex, normal) of the map, None if it is empty.
    """
    wanted = np.zeros(match.shape, bool)
    for at in np.ndindex(match.shape):
        v, n = frame["vertex"][at], frame["normal"][at]
        wanted[at] = match[at] == -1 and v[2] > 0 and n.any() and not frame["edge"][at]
        if wanted[at] and view is not None:
            seen_by, T_view, vertex, normal = view
            T_view_camera = np.linalg.inv(T_view) @ T
            p = T_view_camera[:3, :3] @ v + T_view_camera[:3, 3]
            there = pixel(seen_by, p)
            if there is None:
                wanted[at] = False
                continue
            off, its_normal = p - vertex[there], normal[there]
            on_it = abs(off @ its_normal) < 0.01 + 0.005 * p[2] ** 2
            near = np.linalg.norm(off) < 2 * max(resolution, p[2] / seen_by.fx)
            wanted[at] = not (on_it and near and T_view_camera[:3, :3] @ n @ its_normal > 0.6)
    new = np.zeros_like(wanted)
    for y, x in np.argwhere(wanted):
        v = frame["vertex"][y, x]
        k = int(np.clip(int(resolution * camera.fx / v[2] + 0.5), 1, 16))
        cell = [
            (yy, xx)
            for yy in range(y - y % k, y + 1)
            for xx in range(x - x % k, min(x - x % k + k, match.shape[1]))
        ]
        earlier = [at for at in cell if (at[0] < y or at[1] < x) and wanted[at]]
        new[y, x] = all(np.linalg.norm(frame["vertex"][at] - v) >= 2 * resolution for at in earlier)
    return new


def thin_out(s, camera, vertex, match, resolution) -> np.ndarray:
    """Weights after surfels in a crowd are taken out."""
    weight = s["weight"].copy()
    for y, x in np.argwhere(match >= 0):
        i, near = match[y, x], 0.5 * resolution
        k = int(np.clip(int(near * camera.fx / vertex[y, x, 2] + 0.5), 0, 16))
        around = match[max(y - k, 0) : y + k + 1, max(x - k, 0) : x + k + 1]
        others = [j for j in around[around >= 0] if j != i and s["weight"][j] > s["weight"][i]]
        if any(np.linalg.norm(s["position"][j] - s["position"][i]) < near for j in others):
            weight[i] = 0
    return weight


def prune(s, camera, T, depth, edge, match, *, time, stable_weight=10.0, max_unseen=20, t_min=0, max_depth=1e9,
          margin=0.05, margin_z2=0.0, decay=3.0, decay_share=0.4) -> np.ndarray:  # fmt: skip
    """Weights after clean-up."""
    position, _ = into_camera(T, s)
    weight = s["weight"].copy()
    for i, p in enumerate(position):
        stable = weight[i] >= stable_weight
        if weight[i] <= 0:
            continue
        if not stable and time - s["t_updated"][i] > max_unseen:
            weight[i] = 0
            continue
        at = pixel(camera, p)
        if at is None or not t_min <= s["t_updated"][i] < time:
            continue
        j = match[at]
        if j >= 0 and s["t_updated"][j] == time and abs(depth[at] - p[2]) < 0.01 + 0.005 * depth[at] ** 2:
            same = s["normal"][i] @ s["normal"][j] > 0.8
            if same and s["radius"][i] * camera.fx > p[2] and s["weight"][i] < s["weight"][j]:
                weight[i] = 0
                continue
        if edge[at] or not 0 < depth[at] <= max_depth:
            continue
        if depth[at] - p[2] > max(margin, margin_z2 * depth[at] ** 2):
            weight[i] = max(weight[i] - max(decay, decay_share * weight[i]), 0) if stable else 0
    return weight


def observation(camera, probabilities, y: int, x: int, rule: str, floor: float, sureness: float):
    """Evidence that a pixel gives its surfel and its weight: bilinear in (log) probabilities; None: says nothing."""
    h, w = probabilities.shape[:2]
    a = np.clip((x + 0.5) * w / camera.width - 0.5, 0, w - 1)
    b = np.clip((y + 0.5) * h / camera.height - 0.5, 0, h - 1)
    total, share, sure = np.zeros(13), 0.0, 0.0
    for yy in range(int(b), min(int(b) + 2, h)):
        for xx in range(int(a), min(int(a) + 2, w)):
            weight = max(1 - abs(a - xx), 0) * max(1 - abs(b - yy), 0)
            p = probabilities[yy, xx].astype(np.float64)
            if weight == 0 or not p[0] <= 0.999 or not p[1:].sum() > 1e-6:
                continue
            q = p[1:] / p[1:].sum()
            entropy = -(q * np.log(np.maximum(q, 1e-9))).sum()
            own = weight * max(1 - entropy / np.log(13), 0.02) ** sureness
            total += own * (q if rule == "mean" else np.log(np.maximum(q, floor)))
            share, sure = share + weight, sure + own
    return (total / share, sure / share) if share >= 0.5 else None


def smooth_probabilities(probabilities, camera, vertex, normal, radius) -> np.ndarray:
    """Averages over a pixel and two rings of eight around it, by distance from its plane and bend of the normal."""
    height, width = probabilities.shape[:2]

    def surface(y, x):
        at = int((y + 0.5) * vertex.shape[0] / height), int((x + 0.5) * vertex.shape[1] / width)
        return vertex[at], normal[at]

    def speaks(p):
        return p[1:].sum() > 1e-6 and p[0] <= 0.999

    out = probabilities.astype(np.float64)
    for y in range(height):
        for x in range(width):
            (v, n), own = surface(y, x), probabilities[y, x]
            if v[2] <= 0 or not n.any() or not speaks(own):
                continue
            reach = min(radius * camera.fx * width / camera.width / v[2], 12)
            total, weights = own.astype(np.float64), 1.0
            for ring in (1, 2):
                for spoke in range(8):
                    angle = (spoke + 0.5 * (ring - 1)) * np.pi / 4
                    a = x + int(np.round(reach * ring / 2 * np.cos(angle)))
                    b = y + int(np.round(reach * ring / 2 * np.sin(angle)))
                    if not (0 <= a < width and 0 <= b < height) or not speaks(probabilities[b, a]):
                        continue
                    u, m = surface(b, a)
                    if u[2] <= 0:
                        continue
                    off = (u - v) @ n / (0.015 + 0.002 * v[2] ** 2)
                    w = np.exp(-0.5 * (off**2 + ((1 - n @ m) / 0.1) ** 2))
                    total, weights = total + w * probabilities[b, a], weights + w
            out[y, x] = total / weights
    return out


def update_labels(
    s,
    camera,
    T,
    depth,
    edge,
    probabilities,
    *,
    rule="bayes",
    floor=1e-3,
    sureness=0.0,
    max_distance=0.05,
    t_min=0,
):
    """The surfels after label fusion; evidence of bayes and geometric with its row maximum at 0."""
    position, _ = into_camera(T, s)
    s = {name: value.copy() for name, value in s.items()}
    for i, p in enumerate(position):
        at = pixel(camera, p)
        if at is None or s["weight"][i] <= 0 or s["t_updated"][i] < t_min or edge[at] or depth[at] <= 0:
            continue
        if abs(p[2] - depth[at]) >= max_distance:
            continue
        seen = observation(camera, probabilities, *at, rule, floor, sureness)
        if seen is None:
            continue
        s["evidence"][i] += seen[0]
        if rule != "mean":
            s["evidence"][i] -= s["evidence"][i].max()
        s["observations"][i] += seen[1]
        s["label"][i] = s["evidence"][i].argmax() + 1
    return s
