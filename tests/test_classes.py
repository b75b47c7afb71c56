"""The NYU40 and NYUv2-13 classes and the mapping between them."""

import numpy as np
import pytest

from dsmap.classes import CLASS_NAMES, CLASS_TO_NYU40, NYU40_NAMES, NYU40_TO_13


@pytest.mark.parametrize(
    ("fine", "coarse"),
    [("wall", "wall"), ("door", "wall"), ("bookshelf", "furniture"), ("desk", "table"), ("curtain", "window"),
     ("floor mat", "floor"), ("television", "tv"), ("pillow", "objects"), ("whiteboard", "objects"),
     ("night stand", "furniture"), ("other prop", "objects"), ("void", "void")],
)  # fmt: skip
def test_nyu40_names_map_as_published(fine: str, coarse: str) -> None:
    assert CLASS_NAMES[NYU40_TO_13[NYU40_NAMES.index(fine)]] == coarse


def test_going_to_nyu40_and_back_changes_nothing() -> None:
    assert len(NYU40_NAMES) == len(NYU40_TO_13) == 41
    assert (NYU40_TO_13[CLASS_TO_NYU40] == np.arange(14)).all()
