"""Distillation: what a teacher's probabilities are worth to a student, and that a cut training goes on with them."""

import dataclasses

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tiny_training import CONFIG, MILD, TINY, coloured_rectangles, weights_hash  # noqa: E402

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights  # noqa: E402
from dsmap.dsnet.config import DSNetPConfig  # noqa: E402
from dsmap.dsnet.datasets.registry import open_set  # noqa: E402
from dsmap.dsnet.training import train as training  # noqa: E402
from dsmap.dsnet.training.distil import between  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.frame import Intrinsics  # noqa: E402
from dsmap.sequences import SequenceWriter  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """Labelled images, a teacher that knows them, and the same images as a recording without labels."""
    folder = tmp_path_factory.mktemp("taught")
    images = coloured_rectangles(folder / "set")
    config = dataclasses.replace(CONFIG, steps=180, validate_every=90, ema=0.9)
    options = {"workers": 0, "progress": False}
    training.train([images], images, folder / "teacher", TINY, MILD, config, **options)
    camera = Intrinsics(64, 64, 60.0, 60.0, 31.5, 31.5)
    with SequenceWriter(folder / "frames", camera, depth_scale=5000.0) as writer:
        for k, file in enumerate(sorted((images / "rgb").glob("*.png"))):
            rgb = np.ascontiguousarray(cv2.imread(str(file))[..., ::-1])
            writer.write(k / 30, rgb, np.full((64, 64), 2.0))
    return images, folder / "teacher" / "best.safetensors", folder / "frames"


def test_frames_without_labels_are_all_void_and_have_geometry(taught):
    data = open_set(f"{taught[2]}@unlabelled")
    example = data.items[3].read()
    assert len(data.items) == 8 and data.has_depth and not example.label.any()
    assert example.geometry.shape == (64, 64, 4) and example.geometry[32, 32, 3] == 1
    assert data.items[3].read(with_geometry=False).geometry is None


@pytest.mark.slow
def test_a_student_learns_what_nobody_labelled(taught, tmp_path):
    images, teacher, frames = taught
    config = dataclasses.replace(CONFIG, steps=180, validate_every=90, ema=0.9, distil=1.0)
    options = {"workers": 0, "progress": False}
    data = [f"{frames}@unlabelled"]
    best = training.train(data, images, tmp_path / "with", TINY, MILD, config, teacher=teacher, **options)
    assert best["class_avg"] > 0.7 and best["pixel_acc"] > 0.8
    short = dataclasses.replace(config, steps=40, validate_every=40)
    alone = training.train(data, images, tmp_path / "alone", TINY, MILD, short, **options)
    assert alone["class_avg"] < 0.5, "without a teacher there is nothing to learn from"


def test_a_training_with_a_teacher_and_frozen_levels_goes_on_bit_for_bit(taught, tmp_path, monkeypatch):
    images, teacher, _ = taught
    net = DSNetPConfig("lite0", widths=(8, 8, 8, 8))
    config = dataclasses.replace(
        CONFIG, steps=4, batch=2, validate_every=2, freeze=2, encoder_lr=0.1, smoothing=0.1, imagenet=False
    )
    options = {"workers": 0, "progress": False, "teacher": teacher}
    training.train([images], images, tmp_path / "whole", net, MILD, config, **options)
    step = training.train_step

    def killed_at_2(state, *rest):
        if state.step == 2:
            raise KeyboardInterrupt
        return step(state, *rest)

    monkeypatch.setattr(training, "train_step", killed_at_2)
    with pytest.raises(KeyboardInterrupt):
        training.train([images], images, tmp_path / "cut", net, MILD, config, **options)
    monkeypatch.setattr(training, "train_step", step)
    with pytest.raises(InputError, match="teacher of this run was"):
        other = {**options, "teacher": tmp_path / "whole" / "best.safetensors"}
        training.train([images], images, tmp_path / "cut", net, MILD, config, resume=True, **other)
    training.train([images], images, tmp_path / "cut", net, MILD, config, resume=True, **options)
    hashes = [weights_hash(tmp_path / name / "best.safetensors") for name in ("whole", "cut")]
    assert hashes[0] == hashes[1]
    model, _ = load_weights(tmp_path / "whole" / "best.safetensors")
    torch.manual_seed(config.seed)
    fresh = training.new_state(net, config, None, "cpu").model
    assert torch.equal(model.encoder.levels[1][0].project.weight, fresh.encoder.levels[1][0].project.weight)
    assert not torch.equal(
        model.encoder.levels[3][0].project.weight, fresh.encoder.levels[3][0].project.weight
    )


def test_a_teacher_answers_for_the_students_prior():
    """Its own trained prior out, the student's in; classes that one of them never saw stay as they are."""
    shares, balance = (0.0, 0.6, 0.3, 0.1, *[0.0] * 10), (0.0, 1.0, 2.0, 4.0, *[0.0] * 10)
    info = WeightsInfo(TINY, shares=shares, balance=balance)
    trained = np.array([0.0, 0.2, 0.2, 0.0, 0.6, *[0.0] * 9])
    own = np.array(shares) * balance
    got = between(info, trained)
    expected = np.log(trained[1:3]) - np.log(own[1:3] / own.sum())
    np.testing.assert_allclose(got[1:3], expected, rtol=1e-6)
    assert not got[[0, *range(3, 14)]].any()
    assert not between(WeightsInfo(TINY), trained).any(), "a teacher of an unknown prior"
