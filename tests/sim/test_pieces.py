"""The catalogue of pieces: sizes, classes, closed outward skins, surfaces that things can stand on."""

import numpy as np
import pytest
from catalogue import PIECES, Entry

from dsmap.classes import CLASS_NAMES
from dsmap.sim_scenes.geometry import lofts, shapes
from dsmap.sim_scenes.pieces import bathroom, beds, books, clutter, kitchen, windows
from dsmap.sim_scenes.scene import Assembly
from dsmap.sim_scenes.textures.palette import Looks

SEEDS = (1, 2, 3)
TRIANGLES = 25_000
"""A piece's share of a room's budget of half a million."""


@pytest.fixture(scope="module")
def palette() -> Looks:
    """One room's materials for all tests: making them takes longer than making furniture."""
    return Looks(np.random.default_rng(0))


def made(entry: Entry, looks: Looks, seed: int) -> Assembly:
    """A piece of the catalogue; materials are drawn anew too."""
    rng = np.random.default_rng(seed)
    looks.rng = rng
    return entry.make(rng, looks)


def signed_volume(shape: shapes.Shape) -> float:
    """Volume inside a closed mesh with outward faces [m^3]."""
    a, b, c = shape.vertices[shape.faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def open_edges(shape: shapes.Shape) -> int:
    """Directed edges (between positions) without their opposite: 0 where the skin is closed and consistent."""
    _, same = np.unique(np.round(shape.vertices * 1e5), axis=0, return_inverse=True)
    faces = same.reshape(-1)[shape.faces]
    a = np.concatenate([faces[:, 0], faces[:, 1], faces[:, 2]])
    b = np.concatenate([faces[:, 1], faces[:, 2], faces[:, 0]])
    keep = a != b
    base = int(same.max()) + 1
    forth, back = a[keep] * base + b[keep], b[keep] * base + a[keep]
    return len(np.setdiff1d(forth, back))


@pytest.mark.parametrize("name", sorted(PIECES))
def test_piece(name: str, palette: Looks) -> None:
    entry = PIECES[name]
    for seed in SEEDS:
        piece = made(entry, palette, seed)
        low, high = piece.bounds()
        size = high - low
        assert (size >= np.array(entry.low) - 1e-6).all() and (size <= np.array(entry.high) + 1e-6).all()
        assert piece.label == entry.label
        assert {label for _, _, label, _ in piece.parts} <= {entry.label, *entry.also}
        assert {entry.label, *entry.also} <= set(CLASS_NAMES)
        assert sum(len(shape.faces) for shape, *_ in piece.parts) < TRIANGLES
        assert all(material in palette.materials for _, material, *_ in piece.parts)
        check_height(entry, name, low, high)
        check_surfaces(piece, low, high)
        for shape, *_ in piece.parts:
            check_skin(shape)


def check_height(entry: Entry, name: str, low: np.ndarray, high: np.ndarray) -> None:
    """Pieces stand on the floor or on what they stand on; ceiling lamps hang below, wall pieces start at 0."""
    if entry.place == "ceiling":
        assert high[2] <= 1e-6
    elif entry.place == "hang":
        assert low[2] >= -1e-6
    elif name in ("toilet", "vanity", "washbasin"):
        assert low[2] > -1e-6
    elif entry.place != "edge":
        assert -0.005 < low[2] < 0.012


def check_surfaces(piece: Assembly, low: np.ndarray, high: np.ndarray) -> None:
    """Surfaces lie inside the piece, have an area, and something of the piece is right under their middle."""
    for x0, y0, x1, y1, z in piece.surfaces:
        assert x1 - x0 > 0.03 and y1 - y0 > 0.03
        assert low[0] - 1e-6 <= x0 and x1 <= high[0] + 1e-6
        assert low[1] - 1e-6 <= y0 and y1 <= high[1] + 1e-6
        for x, y in ((0.5, 0.5), (0.15, 0.5), (0.85, 0.5)):
            at = (x0 + x * (x1 - x0), y0 + y * (y1 - y0))
            top = top_below(piece, *at, z + 0.03)
            assert z - 0.09 < top <= z + 0.03, f"nothing under a surface at height {z:.2f}"


def top_below(piece: Assembly, x: float, y: float, z: float) -> float:
    """Height of the highest face of a piece below a point; -inf if there is none."""
    best = -np.inf
    for shape, *_ in piece.parts:
        bound = shape.bounds()
        if x < bound[0, 0] or x > bound[1, 0] or y < bound[0, 1] or y > bound[1, 1]:
            continue
        a, b, c = shape.vertices[shape.faces].transpose(1, 0, 2)
        area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
        a, b, c, area = (v[np.abs(area) > 1e-12] for v in (a, b, c, area))
        v = ((x - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (y - a[:, 1])) / area
        w = ((b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (x - a[:, 0]) * (b[:, 1] - a[:, 1])) / area
        inside = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1 + 1e-9)
        if inside.any():
            height = (a[:, 2] * (1 - v - w) + b[:, 2] * v + c[:, 2] * w)[inside]
            below = height[height <= z]
            best = max(best, float(below.max())) if len(below) else best
    return best


def check_skin(shape: shapes.Shape) -> None:
    """Finite vertices and uv, no unused index, closed, facing outwards."""
    assert np.isfinite(shape.vertices).all() and np.isfinite(shape.uv).all()
    assert len(shape.uv) == len(shape.vertices)
    assert shape.faces.min() >= 0 and shape.faces.max() < len(shape.vertices)
    assert open_edges(shape) == 0
    assert signed_volume(shape) > 0


def test_one_seed_makes_one_piece() -> None:
    for name in ("bookshelf", "sofa", "base_units", "bed"):
        first, again = (made(PIECES[name], Looks(np.random.default_rng(4)), 4) for _ in range(2))
        assert np.array_equal(
            np.concatenate([p[0].vertices for p in first.parts]),
            np.concatenate([p[0].vertices for p in again.parts]),
        )


def test_every_place_has_small_stable_things(palette: Looks) -> None:
    rng = np.random.default_rng(5)
    for place, makes in clutter.PLACES.items():
        for _ in range(2 * len(makes)):
            thing = clutter.pick(rng, palette, place)
            low, high = thing.bounds()
            assert thing.name and (high - low).max() < 0.8 and abs(low[2]) < 0.005
            assert {label for _, _, label, _ in thing.parts} <= {"objects", "books", "picture"}


def test_shelves_are_full_of_books(palette: Looks) -> None:
    """A bookcase's books, seen from the front, cover at least a third of it (NYUv2 labels them books)."""
    for name, share in (("wide_bookcase", 0.33), ("bookshelf", 0.25)):
        covered = []
        for seed in range(6):
            piece = made(PIECES[name], palette, seed)
            low, high = piece.bounds()
            area = 0.0
            for shape, _, label, _ in piece.parts:
                if label == "books":
                    a, b, c = shape.vertices[shape.faces][:, :, [0, 2]].transpose(1, 0, 2)
                    cross = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (
                        b[:, 1] - a[:, 1]
                    )
                    area += float(np.clip(cross, 0, None).sum() / 2)
            covered.append(area / ((high[0] - low[0]) * high[2]))
        assert np.mean(covered) > share


def test_books_of_a_row_stay_on_their_board(palette: Looks) -> None:
    rng = np.random.default_rng(6)
    for _ in range(40):
        low, high = books.row_of_books(rng, palette, 0.8, 0.33, 0.8).bounds()
        assert low[2] > -1e-6 and high[2] < 0.33
        assert low[0] > -0.401 and high[0] < 0.45


@pytest.mark.parametrize("length", [0.6, 1.3, 2.4, 4.0])
def test_base_units_have_any_length(length: float, palette: Looks) -> None:
    piece = kitchen.base_units(np.random.default_rng(2), palette, length)
    assert np.ptp(piece.bounds()[:, 0]) == pytest.approx(length, abs=0.02)
    cupboards = kitchen.wall_cupboards(np.random.default_rng(2), palette, length)
    assert np.ptp(cupboards.bounds()[:, 0]) == pytest.approx(length, abs=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_window_dressing_hangs_before_the_wall(seed: int, palette: Looks) -> None:
    for kind in ("curtains", "roller_blind", "venetian_blind", "roman_blind"):
        piece = getattr(windows, kind)(np.random.default_rng(seed), palette, 1.5, 0.9, 2.1)
        low, high = piece.bounds()
        assert piece.label == "window" and high[1] <= 1e-6 and low[1] > -0.25
        assert low[2] > 0 and 2.1 < high[2] < 2.45
        assert 1.5 <= high[0] - low[0] < 2.2
        for shape, *_ in piece.parts:
            check_skin(shape)


def test_beds_take_a_width_and_basins_lie_in_their_tops(palette: Looks) -> None:
    for width in (0.9, 1.8):
        piece = beds.bed(np.random.default_rng(3), palette, width)
        assert width <= np.ptp(piece.bounds()[:, 0]) < width + 0.4
    vanity = bathroom.vanity(np.random.default_rng(3), palette)
    assert {label for _, _, label, _ in vanity.parts} == {"furniture", "objects"}


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (lofts.loft([lofts.ring((1, 1), (0, 0, z), 1.0, 64) for z in (0, 2)]), np.pi / 2),
        (lofts.tube([(0, 0, 0), (0, 0, 1), (0, 0, 2)], 0.1, 64), 0.02 * np.pi),
        (lofts.prism([(0, 0), (1, 0), (1, 1), (0, 1)], 0.5), 0.5),
        (lofts.plate_with_hole((1, 1, 0.1), (0.5, 0.5), (0, 0, 0), (0.1, 0), 1.0), 0.1 - np.pi * 0.00625),
    ],
)
def test_lofts_are_closed_and_face_outwards(shape: shapes.Shape, volume: float) -> None:
    assert open_edges(shape) == 0
    assert signed_volume(shape) == pytest.approx(volume, rel=0.02)
