"""The paper's experiments: every table is made, interrupted runs go on, bad input is one sentence."""

import json

import numpy as np
import pytest
from conftest import shared_data
from experiment_data import write_cifar, write_labelled, write_voc

torch = pytest.importorskip("torch")

from dsmap.dsnet.experiments.cells import Cell, run_cells, write_table  # noqa: E402
from dsmap.dsnet.experiments.cifar import compare, sentence  # noqa: E402
from dsmap.dsnet.experiments.nyuv2 import LITERATURE, TABLE4_ORDER  # noqa: E402
from dsmap.dsnet.experiments.voc_view import voc_view  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.tools import cli  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def nyu(tmp_path_factory):
    from dsmap.dsnet.datasets.splits import validation_numbers

    held_back = sorted(validation_numbers())[:3]
    return write_labelled(tmp_path_factory.mktemp("nyu") / "set", [1, 2, 3, 4, *held_back])


def test_a_finished_cell_is_not_computed_again(tmp_path):
    calls = []

    def compute(folder):
        calls.append(folder.name)
        return {"value": len(calls)}

    cells = [Cell("a", {"size": (1, 2)}, compute), Cell("b", {"size": (3, 4)}, compute)]
    lines = []
    assert run_cells(cells[:1], tmp_path, lines.append) == {"a": {"value": 1}}
    assert run_cells(cells, tmp_path, lines.append) == {"a": {"value": 1}, "b": {"value": 2}}
    assert calls == ["a", "b"] and lines[1] == "[1/2] a: there already"
    with pytest.raises(InputError, match=r"a/cell.json: computed with size \[1, 2\] \(now \[5, 6\]\)"):
        run_cells([Cell("a", {"size": (5, 6)}, compute)], tmp_path)
    (tmp_path / "a" / "cell.json").write_text("{")
    with pytest.raises(
        InputError, match=r"a/cell.json: not readable as JSON .*delete it to compute it again"
    ):
        run_cells(cells, tmp_path)


def test_tables_are_csv_and_markdown(tmp_path):
    text = write_table(tmp_path, ("name", "score"), [("a, b", 1.5)])
    assert text == "| name | score |\n| --- | --- |\n| a, b | 1.5 |\n" == (tmp_path / "table.md").read_text()
    assert (tmp_path / "table.csv").read_text() == 'name,score\n"a, b",1.5\n'


def test_an_order_is_weighed_against_its_noise():
    table = {"L3K16": {"accuracy": 0.80, "error": 0.004}, "L4K16": {"accuracy": 0.81, "error": 0.003}}
    order = compare(table, "L4K16")
    assert order["order"] == ["L4K16", "L3K16"] and order["reproduced"] and order["significant"] is not None
    assert order["gap"] == pytest.approx(0.01) and order["two_sigma"] == pytest.approx(0.01)
    table["L5K16"] = {"accuracy": 0.84, "error": 0.0}
    order = compare(table, "L4K16")
    assert not order["reproduced"] and order["significant"] and order["rival"] == "L5K16"
    assert "L4K16 best: NOT as in the paper; it differs from L5K16 by -3.00 points, more than" in sentence(
        order
    )
    assert compare({"L3K16": table["L3K16"]}, "L4K16")["reproduced"] is None


def test_cifar_experiment_makes_its_table_and_goes_on(tmp_path, capsys):
    data, out = write_cifar(tmp_path / "cifar"), tmp_path / "out"
    command = [
        "cifar-lk",
        "--data",
        str(data),
        "--out",
        str(out),
        "--epochs",
        "1",
        "--cells",
        "L3K16",
        "L4K16",
    ]
    assert cli.run("experiment", command) == 0
    printed = capsys.readouterr().out
    assert (
        "what it cannot show" not in printed and "small: 6 epochs" in printed and "order here: L" in printed
    )
    results = json.loads((out / "results.json").read_text())
    assert set(results["cells"]) == {"L3K16", "L4K16"} and results["orders"]["K"]["reproduced"] is None
    for name in ("table.csv", "table.md", "fig6.png", "fig7.png"):
        assert (out / name).stat().st_size > 0
    assert cli.run("experiment", [*command, "--seeds", "2"]) == 0
    assert capsys.readouterr().out.count("there already") == 2
    again = json.loads((out / "results.json").read_text())["cells"]
    assert (
        again["L4K16"]["runs"][0] == results["cells"]["L4K16"]["runs"][0] and len(again["L4K16"]["runs"]) == 2
    )
    assert cli.run("experiment", [*command[:-3], "--cells", "L9K9"]) == 2
    assert "cells L9K9" in capsys.readouterr().err


def test_encoders_are_compared(tmp_path):
    data, out = write_cifar(tmp_path / "cifar", 160), tmp_path / "out"
    assert (
        cli.run("experiment", ["cifar-deconvnet", "--data", str(data), "--out", str(out), "--epochs", "1"])
        == 0
    )
    results = json.loads((out / "results.json").read_text())
    assert set(results["cells"]) == {"DS-Net", "DeconvNet"} and (out / "fig8.png").exists()
    assert results["order"]["paper_best"] == "DS-Net"


@pytest.mark.parametrize("official", [True, False])
def test_no_validation_image_of_voc_is_trained_on(tmp_path, official):
    voc = write_voc(tmp_path / "voc", official=official)
    view = voc_view([voc], tmp_path / "view")
    lists = tmp_path / "view" / "voc" / "ImageSets" / "Segmentation"
    train, val = ((lists / f"{name}.txt").read_text().split() for name in ("train", "val"))
    assert (
        val == (["i0", "i1"] if official else ["i4", "i9"]) and len(train) == 8 and not set(train) & set(val)
    )
    assert view.about == {"train_images": 8, "val_images": 2, "official_val": official}
    few = voc_view([voc], tmp_path / "few", images=3, val_images=1, seed=2)
    assert few.about["train_images"] == 3 and few.about["val_images"] == 1
    with pytest.raises(InputError, match="expected PASCAL VOC 2012 first"):
        voc_view([tmp_path], tmp_path / "none")
    other = write_voc(tmp_path / "other")
    with pytest.raises(InputError, match=r"JPEGImages: leads to .*expected .* as now or a new --out"):
        voc_view([other], tmp_path / "view")


def test_voc_table_and_its_baselines(tmp_path, capsys):
    voc, out = write_voc(tmp_path / "voc"), tmp_path / "out"
    command = ["voc-lk", "--data", str(voc), "--out", str(out), "--steps", "1", "--workers", "0"]
    assert cli.run("experiment", [*command, "--cells", "L3K8", "deconvnet"]) == 0
    assert (
        "deconvnet left out: DeconvNet: image is 128x128, expected at least 224x224"
        in capsys.readouterr().out
    )
    results = json.loads((out / "results.json").read_text())
    assert "L3K8" in results["cells"] and "deconvnet" in results["skipped"] and (out / "table2.png").exists()
    assert results["cells"]["L3K8"]["history"][-1]["step"] == 1
    assert cli.run("experiment", [*command, "--cells", "L3K8"]) == 0
    assert "L3K8: there already" in capsys.readouterr().out


@pytest.mark.slow
def test_voc_sample_of_the_real_data(tmp_path):
    out = tmp_path / "out"
    command = ["voc-lk", "--data", str(shared_data("voc2012_60")), "--out", str(out), "--workers", "0"]
    assert cli.run("experiment", [*command, "--steps", "2", "--cells", "L3K8"]) == 0
    results = json.loads((out / "results.json").read_text())
    assert results["data"] == {"train_images": 48, "val_images": 12, "official_val": False}
    assert 0 <= results["cells"]["L3K8"]["miou"] <= 1


def test_recipe_by_way_of_voc(tmp_path, nyu, capsys):
    out = tmp_path / "out"
    command = [
        "voc-nyu",
        "--data",
        str(write_voc(tmp_path / "voc")),
        "--out",
        str(out),
        "--steps",
        "1",
        "--workers",
        "0",
    ]
    assert cli.run("experiment", command) == 2
    assert "expected --nyu PATH" in capsys.readouterr().err
    assert cli.run("experiment", [*command, "--nyu", str(nyu)]) == 0
    results = json.loads((out / "results.json").read_text())
    assert list(results["cells"]) == ["voc", "nyu_after_voc", "nyu_alone"]
    settings = json.loads((out / "nyu_after_voc" / "cell.json").read_text())["settings"]
    assert settings["train"]["init_lr"] == 0.125 and settings["init"] == "voc"
    assert settings["net"]["classes"] == 14 and (out / "voc_nyu.png").exists()


def test_weights_stand_beside_table_4(tmp_path, nyu, capsys):
    out = tmp_path / "out"
    assert cli.run("experiment", ["nyuv2", "--data", f"{nyu}@val", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "| the paper | 37.8 | 45.2 |" in printed and "| shipped, single frames | " in printed
    assert json.loads((out / "results.json").read_text())["images"] == 3
    for row in LITERATURE.values():
        assert len(row) == len(TABLE4_ORDER) + 1
        assert np.mean(row[:-1]) == pytest.approx(row[-1], abs=0.11)
    twice = ["--weights", str(tmp_path / "a" / "w.safetensors"), str(tmp_path / "b" / "w.safetensors")]
    assert cli.run("experiment", ["nyuv2", "--data", f"{nyu}@val", "--out", str(out), *twice]) == 2
    assert "w twice, expected files of different names" in capsys.readouterr().err


@pytest.mark.slow
def test_curve_over_rendered_data(tmp_path, nyu, capsys):
    rooms, out = tmp_path / "rooms", tmp_path / "out"
    command = ["rendered-curve", "--data", str(nyu), "--out", str(out), "--steps", "1", "--workers", "0"]
    assert cli.run("experiment", [*command, "--rendered", str(rooms)]) == 2
    assert "0 recordings, expected a folder of at least 4" in capsys.readouterr().err
    for k in range(4):
        write_labelled(rooms / str(k), [k])
    assert cli.run("experiment", [*command, "--rendered", str(rooms)]) == 0
    cells = json.loads((out / "results.json").read_text())["cells"]
    assert [name for name in cells if name.startswith("nyu")] == [f"nyu_after_{k}" for k in (0, 25, 50, 100)]
    table = (out / "table.csv").read_text().splitlines()
    assert [line.rsplit(",", 1)[1] for line in table[1:]] == ["0", "1", "1", "2", "2", "4", "4"]
    assert (out / "rendered_curve.png").exists()
