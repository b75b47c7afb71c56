"""Small values of the command line that several commands share."""

import math

from dsmap.errors import InputError
from dsmap.limits import MAX_IMAGE_PIXELS
from dsmap.plain import brief


def parse_size(text: str | None) -> tuple[int, int] | None:
    """`640x480` to (640, 480)."""
    if text is None:
        return None
    parts = text.lower().split("x")
    sides = [int(part) for part in parts if part.isascii() and part.isdigit() and len(part) < 9]
    if len(parts) != 2 or len(sides) != 2 or min(sides) < 1:
        raise InputError(f"size is {brief(text)}; expected WIDTHxHEIGHT, e.g. 320x240")
    width, height = sides
    if width * height > MAX_IMAGE_PIXELS:
        raise InputError(f"size is {brief(text)}; expected at most {MAX_IMAGE_PIXELS:,} pixels")
    return width, height


def parse_intrinsics(text: str | None) -> tuple[float, float, float, float] | None:
    """`fx,fy,cx,cy` to four numbers [px]."""
    if text is None:
        return None
    try:
        fx, fy, cx, cy = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            f"intrinsics are {brief(text)}; expected four numbers fx,fy,cx,cy, e.g. 525,525,319.5,239.5"
        ) from error
    if not (fx > 0 and fy > 0 and all(map(math.isfinite, (fx, fy, cx, cy)))):
        raise InputError(
            f"intrinsics are {brief(text)}; expected finite numbers, positive focal lengths fx and fy"
        )
    return fx, fy, cx, cy
