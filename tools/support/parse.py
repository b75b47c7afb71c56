"""Small values of the command line that several commands share."""

from dsmap.errors import InputError


def parse_size(text: str | None) -> tuple[int, int] | None:
    """`640x480` to (640, 480)."""
    if text is None:
        return None
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isdigit() and int(part) > 0 for part in parts):
        raise InputError(f"size is {text!r}; expected WIDTHxHEIGHT, e.g. 320x240")
    return int(parts[0]), int(parts[1])


def parse_intrinsics(text: str | None) -> tuple[float, float, float, float] | None:
    """`fx,fy,cx,cy` to four numbers [px]."""
    if text is None:
        return None
    try:
        fx, fy, cx, cy = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            f"intrinsics are {text!r}; expected four numbers fx,fy,cx,cy, e.g. 525,525,319.5,239.5"
        ) from error
    if fx <= 0 or fy <= 0:
        raise InputError(f"intrinsics are {text!r}; expected positive focal lengths fx and fy")
    return fx, fy, cx, cy
