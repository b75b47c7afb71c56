"""Training of classifiers: it learns, and a killed run goes on as if nothing had happened."""

import numpy as np
import pytest
from experiment_data import coloured

torch = pytest.importorskip("torch")

from dsmap.dsnet.config import ClassifierConfig, DSNetConfig  # noqa: E402
from dsmap.dsnet.training import classify  # noqa: E402
from dsmap.dsnet.training.classify import ClassifyConfig, shift_and_flip, train_classifier  # noqa: E402
from dsmap.errors import InputError  # noqa: E402

NET = ClassifierConfig(DSNetConfig(layers=2, growth=4, widths=(8, 8, 8, 8), classes=10, dropout=0.1), 2)
CONFIG = ClassifyConfig(epochs=3, batch=20, lr=0.1)


pytestmark = pytest.mark.usefixtures("one_thread")


def test_an_image_is_shifted_and_mirrored_whole():
    images = coloured(6).images
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(shift_and_flip(images, 0, 0.0, rng), images)
    np.testing.assert_array_equal(shift_and_flip(images, 0, 1.0, rng), images[:, :, ::-1])
    moved = shift_and_flip(images, 4, 0.0, np.random.default_rng(1))
    down, right = np.random.default_rng(1).integers(0, 9, (2, 6))
    for image, result, y, x in zip(images, moved, down, right, strict=True):
        np.testing.assert_array_equal(
            result, np.pad(image, ((4, 4), (4, 4), (0, 0)), constant_values=127)[y:, x:][:32, :32]
        )


def test_a_classifier_learns(tmp_path):
    config = ClassifyConfig(epochs=8, batch=20, lr=0.1, amp=False)
    result = train_classifier(
        NET, coloured(), coloured(50, 1), config, tmp_path / "c.safetensors", progress=False
    )
    assert result["accuracy"] > 0.5 and result["history"][-1]["loss"] < result["history"][0]["loss"]
    assert result["accuracy"] == result["history"][-1]["accuracy"] and len(result["history"]) == 8


@pytest.mark.parametrize("amp", [False, True])
def test_a_killed_classifier_goes_on_as_if_nothing_had_happened(tmp_path, monkeypatch, amp):
    def run(path):
        config = ClassifyConfig(epochs=3, batch=20, lr=0.1, amp=amp)
        result = train_classifier(NET, coloured(), coloured(50, 1), config, path, progress=False)
        return result["history"]

    whole = run(tmp_path / "whole.safetensors")
    train_epoch = classify._train_epoch

    def killed(model, optimiser, images, config, epoch):
        if epoch == 2:
            raise KeyboardInterrupt
        return train_epoch(model, optimiser, images, config, epoch)

    monkeypatch.setattr(classify, "_train_epoch", killed)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "cut.safetensors")
    monkeypatch.undo()
    assert run(tmp_path / "cut.safetensors") == whole
    with pytest.raises(InputError, match=r"settings of this run was .*expected as now"):
        train_classifier(
            NET, coloured(), coloured(50), ClassifyConfig(epochs=9, batch=20), tmp_path / "cut.safetensors"
        )


def test_too_few_images_are_named(tmp_path):
    with pytest.raises(
        InputError, match="7 images to train on and 0 to measure with, expected at least 20 and 1"
    ):
        train_classifier(NET, coloured(7), coloured(0), CONFIG, tmp_path / "c.safetensors")
