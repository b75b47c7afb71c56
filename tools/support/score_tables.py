"""Tables of scores for the terminal."""

from typing import Any

_COLUMNS = {
    "single_frame": "network alone",
    "map": "map",
    "map_only": "map only",
    "map_only_off_edges": "off edges",
    "surfels": "surfels 3D",
    "labels": "label images",
}
"""Keys of `semantics` and how the table names them."""
_LABEL_ROWS = (("class average", "class_avg"), ("pixel accuracy", "pixel_acc"), ("mean IoU", "miou"))


def run_tables(metrics: dict[str, Any]) -> str:
    """All tables of a run's metrics."""
    parts = [
        _section("Trajectory", metrics["trajectory"], _trajectory_rows(metrics["trajectory"])),
        _section("Loops", metrics["loops"], _loop_rows(metrics["loops"])),
        _section("Surface", metrics["surface"], _surface_rows(metrics["surface"])),
        _labels(metrics["semantics"]),
        _section("Objects", metrics["objects"], _object_rows(metrics["objects"])),
        _section("Floor plan", metrics["floor_plan"], _floor_plan_rows(metrics["floor_plan"])),
        _section("Map", metrics["map"], [(k.replace("_", " "), _count(metrics["map"][k])) for k in _MAP]),
        _section("Speed", metrics["speed"], _speed_rows(metrics["speed"])),
    ]
    return "\n\n".join(parts)


_MAP = ("frames", "surfels", "graph_nodes", "local_loops", "global_loops")


def network_table(metrics: dict[str, Any]) -> str:
    """The table of a network alone: the single-frame column of the paper's Table 4."""
    return f"{metrics['frames']} labelled images\n" + _labels({"single_frame": metrics["single_frame"]})


def labels_table(metrics: dict[str, Any]) -> str:
    """The table of label images alone."""
    return _labels({key: metrics[key] for key in ("labels", "coverage", "frames")})


def _trajectory_rows(t: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("tracked frames", _percent(t["tracked_fraction"])),
        ("ATE RMSE, SE(3)-aligned", _mm(t["ate_rmse_m"])),
        ("ATE RMSE, first poses equal", _mm(t["ate_rmse_unaligned_m"])),
        ("RPE over 1 s", f"{_mm(t['rpe_trans_rmse_m'])}, {_number(t['rpe_rot_rmse_deg'], 2, ' deg')}"),
    ]
    for name, key in (("estimated", "depth_consistency_m"), ("given", "depth_consistency_given_m")):
        if key in t:
            steps = ", ".join(f"{_mm(v)} at {k} frames" for k, v in t[key].items() if k != "reason")
            rows.append((f"depth consistency, {name} poses", steps))
    for name, key in (("estimated", "epipolar_px"), ("given", "epipolar_given_px")):
        if any(v is not None for v in t.get(key, {}).values()):
            steps = ", ".join(f"{_number(v, 2, ' px')} at {k} frames" for k, v in t[key].items())
            rows.append((f"epipolar error, {name} poses", steps))
    if sfm := t.get("sfm"):
        for name in ("estimated", "given"):
            if sfm[f"{name}_rmse_m"] is not None:
                rows.append((f"RMSE to colour alone, {name} poses", _mm(sfm[f"{name}_rmse_m"])))
        rows.append(("COLMAP's poses", sfm.get("reason", f"{sfm['registered']} of {sfm['frames']} images")))
    return rows


def _loop_rows(t: dict[str, Any]) -> list[tuple[str, str]]:
    kinds = ", ".join(f"{count} {kind}" for kind, count in (t["kinds"] or {}).items())
    rows = [("closed", _count(t["closed"]) + (f" ({kinds})" if kinds else ""))]
    if t["bent"] is not None:
        rows.append(("of these, bent the map", _count(t["bent"])))
    if t["compared"] is not None:
        rows += [
            ("correct", f"{t['correct']} of {t['compared']} compared"),
            ("wrong (> 5 cm or > 3 deg)", _count(t["wrong"])),
            ("relative pose, median and worst", f"{_mm(t['distance_median_m'])}, {_mm(t['distance_max_m'])}"),
        ]
    return rows


def _surface_rows(s: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        ("distance to the mesh, mean", _mm(s["accuracy_mean_m"])),
        ("distance to the mesh, median", _mm(s["accuracy_median_m"])),
        ("mean with first poses equal", _mm(s["accuracy_mean_unaligned_m"])),
        ("completeness at 5 cm", _percent(s["completeness_5cm"])),
        ("F-score at 5 cm", _percent(s["fscore_5cm"])),
    ]


def _object_rows(o: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("mean AP of boxes at 0.5", _percent(o["map50"])),
        ("precision", _percent(o["precision"])),
        ("recall", _percent(o["recall"])),
    ]
    if o["supports"] is not None:
        rows.append(("supports", "{right} right of {stated} stated, {asked} asked".format(**o["supports"])))
    return rows


def _floor_plan_rows(f: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        ("cells called free that are", _percent(f["free_precision"])),
        ("free cells that were seen, found", _percent(f["free_recall"])),
        ("occupied cells called free", _percent(f["occupied_as_free"])),
    ]


def _speed_rows(s: dict[str, Any]) -> list[tuple[str, str]]:
    stages = s["stages_ms"] or {}
    memory = s["peak_rss_bytes"]
    return [
        ("frames per second", _number(s["fps"], 1)),
        ("peak memory", "-" if memory is None else f"{memory / 2**20:.0f} MiB"),
        *((f"  {name}", f"{ms:.1f} ms") for name, ms in stages.items()),
    ]


def _labels(semantics: dict[str, Any]) -> str:
    """Classes down, kinds of answer across."""
    columns = [key for key in _COLUMNS if key in semantics and semantics[key]["class_avg"] is not None]
    title = "Labels"
    if "coverage" in semantics and semantics["coverage"] is not None:
        title += f" ({semantics['frames']} frames, coverage {_percent(semantics['coverage'])})"
    if not columns:
        reason = semantics.get("reason") or semantics["single_frame"].get("reason", "nothing to score")
        return f"{title}\n  not scored: {reason}"
    classes = list(dict.fromkeys(name for key in columns for name in semantics[key]["per_class"]))
    lines = [f"  {'recall':<16}" + "".join(f"{_COLUMNS[key]:>15}" for key in columns)]
    for name in classes:
        cells = (semantics[key]["per_class"].get(name, {}).get("recall") for key in columns)
        lines.append(f"  {name:<16}" + "".join(f"{_percent(cell):>15}" for cell in cells))
    for name, key in _LABEL_ROWS:
        lines.append(f"  {name:<16}" + "".join(f"{_percent(semantics[c][key]):>15}" for c in columns))
    ece = "".join(f"{_number(semantics[c].get('ece'), 3):>15}" for c in columns)
    reasons = [
        f"  {_COLUMNS[k]} not scored: {semantics[k]['reason']}" for k in _COLUMNS if _unscored(semantics, k)
    ]
    return "\n".join([title, *lines, f"  {'ECE':<16}{ece}", *reasons])


def _unscored(semantics: dict[str, Any], key: str) -> bool:
    return key in semantics and semantics[key]["class_avg"] is None and "reason" in semantics[key]


def _section(title: str, tree: dict[str, Any], rows: list[tuple[str, str]]) -> str:
    reason = tree.get("reason")
    if reason and all(value in (None, reason) for value in tree.values()):
        return f"{title}\n  not scored: {reason}"
    lines = [f"  {name:<38}{text}" for name, text in rows]
    return "\n".join([title, *lines, *([f"  {reason}"] if reason else [])])


def _number(value: float | None, digits: int, unit: str = "") -> str:
    return "-" if value is None else f"{value:.{digits}f}{unit}"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{value * 1e3:.1f} mm"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value * 100:.1f} %"


def _count(value: int | None) -> str:
    return "-" if value is None else f"{value:,}"
