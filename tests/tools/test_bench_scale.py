"""`dsmap bench-scale`: the maps have the sizes asked for, and the same view."""

import json

import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.tools.commands.bench_scale import Args, main, measure


def test_the_same_view_in_a_larger_map(tmp_path, capsys):
    out = tmp_path / "scale.json"
    assert main(Args(surfels="0.02,0.3", frames=2, size="96x72", out=out)) == 0
    report = json.loads(out.read_text())
    small, large = report["maps"]
    np.testing.assert_allclose([small["surfels"], large["surfels"]], [2e4, 3e5], rtol=0.1)
    assert small["tracked"] == large["tracked"] == 2
    walked = [row["in_view_blocks"] * row["surfels"] for row in (small, large)]
    assert walked[1] < 2 * walked[0], "what is walked follows the view"
    assert 113 <= large["bytes_per_surfel"] < 114 and large["culling_bytes_per_surfel"] < 0.5
    assert "ratio" in capsys.readouterr().out


def test_walking_everything_is_said_and_done():
    report = measure([30_000], 1, (96, 72), "cpu", walk=True)
    assert report["walk"] and report["maps"][0]["in_view_blocks"] == 1.0


@pytest.mark.parametrize(("field", "value"), [("surfels", "much"), ("surfels", "-1"), ("frames", 0)])
def test_bad_arguments(field, value, tmp_path):
    with pytest.raises(InputError, match=f"--{field} is .*{value}"):
        main(Args(**{field: value, "out": tmp_path / "x.json"}))
