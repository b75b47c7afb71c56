"""Legs that sofas, chairs and tables stand on."""

from dsmap.sim_scenes.geometry.shapes import box, lathe
from dsmap.sim_scenes.scene import Assembly


def straight_legs(
    piece: Assembly, material: str, width: float, depth: float, height: float, thick: float, square: bool
) -> None:
    """Four legs under a board of width x depth [m]: square posts, or turned ones that taper downwards."""
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (width / 2 - thick), y * (depth / 2 - thick), 0)
            if square:
                piece.add(box((thick, thick, height), at), material)
            else:
                piece.add(lathe([(thick * 0.35, 0), (thick * 0.6, height)], at, 16), material)
