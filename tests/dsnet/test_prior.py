"""The class prior of a network's answers: logit adjustment (Menon et al. 2021), in the header and in the engines."""

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights, save_tensors, save_weights  # noqa: E402
from dsmap.dsnet.config import DSNetConfig  # noqa: E402
from dsmap.dsnet.inference.predict import load_segmenter  # noqa: E402
from dsmap.dsnet.networks.dsnet import DSNet  # noqa: E402
from dsmap.dsnet.training.model_card import model_card  # noqa: E402
from dsmap.errors import InputError  # noqa: E402

TINY = DSNetConfig(layers=1, growth=4, widths=(4, 4, 4, 4), stem_convs=1)
SHARES = (0.0, 0.5, 0.3, 0.15, 0.05, *[0.0] * 9)
BALANCE = (0.0, 0.5, 0.7, 1.0, 1.6, *[0.0] * 9)


def info(prior=0.5, **more):
    return WeightsInfo(TINY, (64, 64), prior=prior, shares=SHARES, balance=BALANCE, **more)


@pytest.mark.parametrize("prior", [0.0, 0.3, 1.0])
def test_the_offset_turns_the_trained_prior_into_the_wanted_one(prior):
    """A uniform posterior of the likelihood: the network gives the trained prior, the offset makes the wanted one."""
    share, balance = np.array(SHARES)[1:5], np.array(BALANCE)[1:5]
    trained = np.log(share * balance)
    answer = np.exp(trained + info(prior).offset()[1:5])
    wanted = share ** (1 - prior)
    np.testing.assert_allclose(answer / answer.sum(), wanted / wanted.sum(), rtol=1e-5)
    assert not info(prior).offset()[5:].any(), "classes that were never seen"


def test_the_ends_are_best_in_what_they_are_for():
    """Classes of known likelihoods: prior 0 has most pixels right, prior 1 the best average over classes."""
    rng, means = np.random.default_rng(0), np.random.default_rng(1).normal(0, 1.2, (4, 3))
    share, balance = np.array(SHARES)[1:5], np.array(BALANCE)[1:5]
    truth = rng.choice(4, size=40_000, p=share)
    seen = means[truth] + rng.normal(size=(len(truth), 3))
    likelihood = -0.5 * ((seen[:, None] - means) ** 2).sum(axis=2)
    logits = likelihood + np.log(share * balance)  # what weighted cross entropy converges to
    pixels, classes = {}, {}
    for prior in (0.0, 0.5, 1.0):
        right = (logits + info(prior).offset()[1:5]).argmax(axis=1) == truth
        pixels[prior] = right.mean()
        classes[prior] = np.mean([right[truth == c].mean() for c in range(4)])
    assert pixels[0.0] > pixels[0.5] > pixels[1.0] + 0.01
    assert classes[1.0] > classes[0.5] > classes[0.0] + 0.01


def test_the_header_holds_the_prior_and_older_files_load_without(tmp_path):
    torch.manual_seed(0)
    path, model = tmp_path / "net.safetensors", DSNet(TINY)
    notes = {"priors": {"0": {"class_avg": 0.5, "pixel_acc": 0.75, "miou": 0.4, "ece": 0.02}}}
    notes["validation"] = {"step": 3, "class_avg": 0.6, "per_class": {"bed": {"recall": 0.7, "iou": 0.5}}}
    save_weights(path, model, info(0.25, notes=notes))
    _, found = load_weights(path)
    assert (found.prior, found.shares, found.balance) == (0.25, SHARES, BALANCE)
    card = model_card(found, "net")
    assert "Class prior: 0.25" in card and "| 0 | 50.0 | 40.0 | 75.0 | 2.0 |" in card
    assert "| bed | 50.0 | 70.0 | 50.0 |" in card
    header = {"config": {**json.loads(json.dumps(TINY.__dict__))}, "size": [64, 64], "temperature": 1.0}
    header |= {"class_names": list(found.class_names), "notes": {}}
    save_tensors(path, model.state_dict(), "dsmap.dsnet", header)
    _, older = load_weights(path)
    assert older.shares == () and not older.offset().any()
    save_tensors(path, model.state_dict(), "dsmap.dsnet", {**header, "shares": [1.0], "balance": [1.0]})
    with pytest.raises(InputError, match="shares and balance of other classes"):
        load_weights(path)


@pytest.mark.parametrize("engine", ["torch", "onnx"])
def test_a_prior_that_is_asked_for_counts_in_every_engine(tmp_path, engine):
    if engine == "onnx":
        pytest.importorskip("onnxruntime")
    torch.manual_seed(0)
    path = tmp_path / "net.safetensors"
    save_weights(path, DSNet(TINY), info(0.5, temperature=1.3))
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    answers = {p: load_segmenter(path, engine=engine, prior=p).predict(image) for p in (None, 0.5, 0.0, 1.0)}
    np.testing.assert_array_equal(answers[None], answers[0.5])
    expected = np.log(answers[0.0]) + (info(1.0).offset() - info(0.0).offset()) / 1.3
    expected = np.exp(expected) / np.exp(expected).sum(axis=2, keepdims=True)
    np.testing.assert_allclose(answers[1.0], expected, atol=1e-5)
    with pytest.raises(InputError, match="prior is 2, expected 0"):
        load_segmenter(path, prior=2.0)
