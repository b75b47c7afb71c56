"""Recipes, copy-paste, several processes, logs and model cards."""

import dataclasses
import os
import socket
import subprocess
import sys

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tiny_training import CONFIG, MILD, TINY, coloured_rectangles, weights_hash  # noqa: E402

from dsmap.dsnet.checkpoint import SHIPPED, load_weights  # noqa: E402
from dsmap.dsnet.data import LabelledImages  # noqa: E402
from dsmap.dsnet.datasets.base import Example  # noqa: E402
from dsmap.dsnet.datasets.registry import open_set  # noqa: E402
from dsmap.dsnet.training import train as training  # noqa: E402
from dsmap.dsnet.training.average import mean_of  # noqa: E402
from dsmap.dsnet.training.copy_paste import Donors, paste, pick_object  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.tools import cli  # noqa: E402
from dsmap.tools.commands.train import Args  # noqa: E402
from dsmap.tools.support.recipes import load_recipe, parse_stage, words  # noqa: E402

RECIPE = """
places: {set: nowhere}
data: ["${set}"]
val: "${set}"
net: {layers: 1, growth: 4, stem_convs: 1}
batch: 2
size: [64, 64]
augment: {copy_paste: 0.5}
stages:
  - {name: first, steps: 2, lr: 2e-2}
  - {name: second, steps: 3, precision: bf16, shares: [1]}
"""


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    return coloured_rectangles(tmp_path_factory.mktemp("images") / "set")


def test_pasting_changes_colour_label_and_depth_at_the_same_pixels():
    mask = np.zeros((40, 60), bool)
    mask[20:30, 20:35] = True
    source = Example(
        np.full((40, 60, 3), 200, np.uint8),
        np.where(mask, 4, 12).astype(np.uint8),
        np.full((40, 60, 4), 2, np.float16),
    )
    target = Example(
        np.zeros((80, 120, 3), np.uint8),
        np.full((80, 120), 5, np.uint8),
        np.full((80, 120, 4), 9, np.float16),
    )
    for seed in range(5):
        found = paste(target, source, mask, np.random.default_rng(seed))
        changed = found.label != 5
        assert set(found.label[changed]) == {4} and changed.sum() > 100
        np.testing.assert_array_equal(changed, found.rgb[..., 0] == 200)
        assert found.geometry.dtype == np.float16 and set(found.geometry[changed].ravel()) == {2}
        assert set(found.geometry[~changed].ravel()) == {9}
    np.testing.assert_array_equal(pick_object(source.label, 4, np.random.default_rng(0)), mask)
    assert pick_object(source.label, 7, np.random.default_rng(0)) is None


def test_donors_are_objects_and_the_result_is_a_function_of_the_key(images):
    data = LabelledImages(open_set(images), progress=False)
    donors = Donors(data)
    assert set(donors.images[0]) <= {1, 9}  # never floor or wall
    first, second = (donors.paste_into(3, np.random.default_rng(1)) for _ in range(2))
    np.testing.assert_array_equal(first.rgb, second.rgb)


def test_a_recipe_trains_all_stages_the_same_twice_and_resumes(images, tmp_path, capsys, monkeypatch):
    file = tmp_path / "recipe.yaml"
    file.write_text(RECIPE)
    base = ["--recipe", str(file), "--places", f"set={images}", "--workers", "0", "--no-log"]
    hashes = []
    for name in "ab":
        assert cli.run("train", [*base, "--out", str(tmp_path / name)]) == 0, capsys.readouterr().err
        hashes.append(weights_hash(tmp_path / name / "best.safetensors"))
    assert hashes[0] == hashes[1]
    _, info = load_weights(tmp_path / "a" / "best.safetensors")
    assert len(info.notes["stages"]) == 1 and "--precision bf16" in info.notes["command"]
    card = (tmp_path / "a" / "model-card.md").read_text()
    assert "--lr 0.02" in card and "| wall |" in card and "nothing stated" in card
    card = tmp_path / "card.md"
    argv = [str(tmp_path / "a" / "best.safetensors"), str(card), "--licence-note", "research only"]
    assert cli.run("model-card", argv) == 0 and "research only" in card.read_text()
    monkeypatch.setattr(training, "train_step", None)  # nothing is left to do
    assert cli.run("train", [*base, "--out", str(tmp_path / "a"), "--resume"]) == 0


def test_shipped_recipes_are_options_of_train_and_mistakes_are_named(tmp_path):
    for name in ("dsnet-p-nyuv2", "dsnet-nyuv2", "voc-nyu"):
        for stage in load_recipe(name).stages:
            assert parse_stage(stage, Args, tmp_path).data
    assert words({"net": {"geometry": True}, "size": [1, 2]}) == ["--net.geometry", "--size", "1", "2"]
    with pytest.raises(InputError, match="no such file"):
        load_recipe("nothing")
    file = tmp_path / "bad.yaml"
    file.write_text("stages: [{data: ['${lost}']}]")
    with pytest.raises(InputError, match="'lost' is not given"):
        load_recipe(str(file))
    file.write_text("stages: [{stepz: 4}]")
    with pytest.raises(InputError, match="stepz"):
        parse_stage(load_recipe(str(file)).stages[0], Args, tmp_path)
    file.write_text("average: 2\nstages: [{steps: 4}]")
    with pytest.raises(InputError, match="found average 2, expected how many of its 1 stages"):
        load_recipe(str(file))


def test_a_recipe_may_average_its_last_stages(images, tmp_path, capsys):
    file = tmp_path / "recipe.yaml"
    file.write_text(RECIPE.replace("stages:", "calibrate: ['${set}']\naverage: 2\nstages:"))
    base = ["--recipe", str(file), "--places", f"set={images}", "--workers", "0", "--no-log"]
    assert cli.run("train", [*base, "--out", str(tmp_path / "out")]) == 0, capsys.readouterr().err
    first, second, mean = (
        load_weights(tmp_path / "out" / where / "best.safetensors")[0].state_dict()
        for where in ("1-first", "2-second", ".")
    )
    name = next(key for key in mean if key.endswith("conv.weight") or mean[key].ndim == 4)
    assert not torch.equal(first[name], second[name])
    torch.testing.assert_close(mean[name], (first[name] + second[name]) / 2)
    _, info = load_weights(tmp_path / "out" / "best.safetensors")
    assert (
        "mean of the weights of stages 1-first, 2-second" in (tmp_path / "out" / "model-card.md").read_text()
    )
    assert len(info.notes["stages"]) == 2 and info.notes["validation"]["step"] == 5
    with pytest.raises(InputError, match="expected that of"):
        mean_of([tmp_path / "out" / "best.safetensors", SHIPPED["dsnet"]])


def test_the_log_holds_losses_and_validations(images, tmp_path):
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    config = dataclasses.replace(CONFIG, steps=10, batch=2, validate_every=10)
    training.train([images], images, tmp_path, TINY, MILD, config, workers=0, progress=False, log=True)
    log = events.EventAccumulator(str(tmp_path / "log")).Reload()
    tags = log.Tags()
    assert {"train/loss", "train/lr", "val/miou", "val_iou/wall"} <= set(tags["scalars"]) and tags["images"]


SHORT = (
    "--batch 4 --size 64 64 --workers 0 --no-log --validate-every 3 --lr 1e-3"
    " --net.layers 1 --net.growth 4 --net.stem-convs 1 --net.dropout 0 --ema 0"
)
CUT = """
import os
import sys
from dsmap.dsnet.training import train as training
from dsmap.tools import cli
step = training.train_step
def killed(state, *rest):
    if state.step == 4:
        os._exit(9)  # as a kill would: nothing is tidied up, no thread is waited for
    return step(state, *rest)
training.train_step = killed
sys.exit(cli.main())
"""


def run_training(out, data, steps, processes, *more, program=("-m", "dsmap.tools.cli")):
    """`dsmap train` on one process or on several; returns the exit code."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    launch = ["-m", "torch.distributed.run", f"--nproc-per-node={processes}", f"--master-port={port}"]
    argv = ["train", "--data", str(data), "--val", str(data), "--out", str(out), "--steps", str(steps)]
    command = [sys.executable, *(launch if processes > 1 else []), *program, *argv, *SHORT.split(), *more]
    return subprocess.run(command, env={**os.environ, "OMP_NUM_THREADS": "1"}, timeout=600).returncode


@pytest.mark.slow
def test_two_processes_learn_what_one_does(images, tmp_path):
    """Batch norms, weights of the loss and gradients are those of the whole batch; a resume goes on with it."""
    assert run_training(tmp_path / "one", images, 3, 1) == 0
    assert run_training(tmp_path / "two", images, 3, 2) == 0
    assert run_training(tmp_path / "two", images, 3, 2, "--resume") == 0
    one, _ = load_weights(tmp_path / "one" / "best.safetensors")
    two, _ = load_weights(tmp_path / "two" / "best.safetensors")
    for key, tensor in one.state_dict().items():
        torch.testing.assert_close(tensor, two.state_dict()[key], rtol=2e-3, atol=2e-3, msg=key)


@pytest.mark.slow
def test_two_processes_that_were_killed_go_on_where_they_were(images, tmp_path):
    (tmp_path / "cut.py").write_text(CUT)
    assert run_training(tmp_path / "whole", images, 6, 2) == 0
    assert run_training(tmp_path / "cut", images, 6, 2, program=[str(tmp_path / "cut.py")]) != 0
    assert (tmp_path / "cut" / "checkpoint.safetensors").exists()
    assert run_training(tmp_path / "cut", images, 6, 2, "--resume") == 0
    assert len({weights_hash(tmp_path / name / "best.safetensors") for name in ("whole", "cut")}) == 1
