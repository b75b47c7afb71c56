"""Training: it learns, a killed run goes on as if nothing had happened, and its outputs are usable."""

import dataclasses
import json
import shutil

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tiny_training import CONFIG, MILD, TINY, coloured_rectangles, weights_hash  # noqa: E402

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights  # noqa: E402
from dsmap.dsnet.config import DSNetConfig, DSNetPConfig  # noqa: E402
from dsmap.dsnet.data import LabelledImages  # noqa: E402
from dsmap.dsnet.datasets.base import Example  # noqa: E402
from dsmap.dsnet.datasets.registry import open_set  # noqa: E402
from dsmap.dsnet.inference.predict import DSNetSegmenter, fitting_size, load_segmenter  # noqa: E402
from dsmap.dsnet.networks.dsnet import DSNet  # noqa: E402
from dsmap.dsnet.scoring.measure import fit_temperature, score  # noqa: E402
from dsmap.dsnet.training import train as training  # noqa: E402
from dsmap.dsnet.training.processes import Ranks  # noqa: E402
from dsmap.errors import InputError, InputWarning, WriteError  # noqa: E402
from dsmap.frame import Frame, Intrinsics  # noqa: E402
from dsmap.sequences import SequenceWriter  # noqa: E402
from dsmap.tools import cli  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    return coloured_rectangles(tmp_path_factory.mktemp("images") / "set")


def run(images, out, config=CONFIG, **options):
    return training.train([images], images, out, TINY, MILD, config, workers=0, progress=False, **options)


def test_a_tiny_set_is_learnt_by_heart(images, tmp_path):
    config = dataclasses.replace(CONFIG, steps=180, validate_every=90, ema=0.9)
    best = run(images, tmp_path / "run", config)
    assert best["class_avg"] > 0.75 and best["pixel_acc"] > 0.8 and best["ece"] < 0.2
    assert 0.05 < best["temperature"] < 20
    history = json.loads((tmp_path / "run" / "history.json").read_text())
    assert [record["step"] for record in history] == [90, 180]
    image = cv2.imread(str(images / "rgb" / "0.png"))[..., ::-1]
    frame = Frame(0, 0.0, np.ascontiguousarray(image), np.ones((64, 64), np.float32))
    segmenter = load_segmenter(tmp_path / "run" / "best.safetensors")
    assert segmenter.info.temperature == best["temperature"] and segmenter.info.size == (64, 64)
    answer = segmenter(frame)[..., 1:].argmax(axis=2) + 1
    label = cv2.imread(str(images / "label" / "0.png"), cv2.IMREAD_UNCHANGED)
    assert (answer == label[1::2, 1::2]).mean() > 0.8


def test_a_killed_run_goes_on_as_if_nothing_had_happened(images, tmp_path, monkeypatch):
    whole = run(images, tmp_path / "whole")
    step = training.train_step

    def killed_at_9(state, *rest):
        if state.step == 9:
            raise KeyboardInterrupt
        return step(state, *rest)

    monkeypatch.setattr(training, "train_step", killed_at_9)
    with pytest.raises(KeyboardInterrupt):
        run(images, tmp_path / "cut")
    monkeypatch.setattr(training, "train_step", step)
    resumed = run(images, tmp_path / "cut", resume=True)
    first, _ = load_weights(tmp_path / "whole" / "best.safetensors")
    second, _ = load_weights(tmp_path / "cut" / "best.safetensors")
    for name, tensor in first.state_dict().items():
        assert torch.equal(tensor, second.state_dict()[name]), name
    assert whole["class_avg"] == resumed["class_avg"] and whole["temperature"] == resumed["temperature"]


def test_a_run_is_not_overwritten_nor_continued_with_other_settings(images, tmp_path):
    short = dataclasses.replace(CONFIG, steps=2, validate_every=2)
    run(images, tmp_path / "run", short)
    with pytest.raises(InputError, match="--resume"):
        run(images, tmp_path / "run", short)
    with pytest.raises(
        InputError, match=r"train of this run was \{'lr': 0.01\}, expected as now \{'lr': 0.005\}"
    ):
        run(images, tmp_path / "run", dataclasses.replace(short, lr=5e-3), resume=True)
    checkpoint = tmp_path / "run" / "checkpoint.safetensors"
    shutil.copy(tmp_path / "run" / "best.safetensors", checkpoint)
    with pytest.raises(InputError, match=r"'dsmap.dsnet/2'; expected 'dsmap.dsnet.training/2'"):
        run(images, tmp_path / "run", short, resume=True)


def test_a_full_disk_is_warned_of_and_training_goes_on(images, tmp_path, monkeypatch):
    def full(*args):
        raise WriteError("cannot write it: No space left on device")

    monkeypatch.setattr(training, "save_checkpoint", full)
    short = dataclasses.replace(CONFIG, steps=2, validate_every=2)
    with pytest.warns(InputWarning, match="no checkpoint after step 2 .*No space left.*training goes on"):
        run(images, tmp_path / "run", short)
    assert not (tmp_path / "run" / "checkpoint.safetensors").exists()
    load_weights(tmp_path / "run" / "best.safetensors")


def test_fine_tuning_starts_from_the_given_weights(images, tmp_path):
    short = dataclasses.replace(CONFIG, steps=4, validate_every=4)
    run(images, tmp_path / "first", short)
    best = tmp_path / "first" / "best.safetensors"
    state = training.new_state(TINY, short, best, "cpu")
    given, _ = load_weights(best)
    assert torch.equal(state.model.stem[0][0].weight, given.stem[0][0].weight)
    with pytest.raises(InputError, match="network is"):
        training.new_state(DSNetConfig(), short, best, "cpu")


def test_the_same_command_gives_the_same_weights(images, tmp_path):
    """Whatever the number of processes that prepare images; another seed gives others."""
    short = dataclasses.replace(CONFIG, steps=3, validate_every=3)
    hashes = []
    for name, config, workers in (
        ("a", short, 0),
        ("b", short, 1),
        ("c", dataclasses.replace(short, seed=1), 0),
    ):
        out = tmp_path / name
        training.train([images], images, out, TINY, MILD, config, workers=workers, progress=False)
        hashes.append(weights_hash(out / "best.safetensors"))
    assert hashes[0] == hashes[1] != hashes[2]


def grey_depths(path, count=8):
    """A recording of grey images whose class only depth tells."""
    rng, camera = np.random.default_rng(0), Intrinsics(64, 64, 60.0, 60.0, 31.5, 31.5)
    with SequenceWriter(path, camera, depth_scale=5000.0) as writer:
        for k in range(count):
            label = np.full((64, 64), 12, np.uint8)
            x = int(rng.integers(4, 28))
            label[:, x : x + 30] = 4
            rgb = rng.integers(110, 140, (64, 64, 3), dtype=np.uint8)
            writer.write(k / 30, rgb, np.where(label == 4, 1.0, 3.0), label=label)
    return path


def test_training_with_geometry(tmp_path, images):
    """An RGB-D network learns what only depth tells, and trains on images without depth, too."""
    net = dataclasses.replace(TINY, channels=7, dropout=0.0)
    config = dataclasses.replace(CONFIG, steps=60, validate_every=60, ema=0.8)
    kept = dataclasses.replace(MILD, drop_geometry=0.0, holes=0.0)
    sequence = grey_depths(tmp_path / "seq")
    best = training.train(
        [sequence], sequence, tmp_path / "run", net, kept, config, workers=0, progress=False
    )
    assert best["class_avg"] > 0.85
    short = dataclasses.replace(CONFIG, steps=2, validate_every=2)
    training.train([images, sequence], images, tmp_path / "both", net, MILD, short, workers=0, progress=False)


def test_pre_training_on_voc_and_fine_tuning(images, tmp_path):
    """The recipe voc-nyu in miniature: 21 classes first, then the 13 with a new last layer."""
    voc = tmp_path / "voc"
    for name in ("JPEGImages", "SegmentationClass"):
        (voc / name).mkdir(parents=True)
    for k in range(2):
        cv2.imwrite(str(voc / "JPEGImages" / f"{k}.jpg"), np.full((64, 64, 3), 90 * k, np.uint8))
        cv2.imwrite(str(voc / "SegmentationClass" / f"{k}.png"), np.full((64, 64), 20 * k, np.uint8))
    short = dataclasses.replace(CONFIG, steps=2, validate_every=2, init_lr=0.125)
    first = training.train([voc], voc, tmp_path / "pre", TINY, MILD, short, workers=0, progress=False)
    assert set(first["per_class"]) == {"background", "tv monitor"}
    run(images, tmp_path / "fine", short, init=tmp_path / "pre" / "best.safetensors")
    _, info = load_weights(tmp_path / "fine" / "best.safetensors")
    assert info.config.classes == 14
    with pytest.raises(InputError, match="expected the same"):
        training.train([voc], images, tmp_path / "mixed", TINY, MILD, short, workers=0, progress=False)


def test_learning_rate_warms_up_and_decays():
    rates = [training.learning_rate(step, CONFIG) for step in range(CONFIG.steps)]
    assert rates[0] == CONFIG.lr / 2 and rates[1] == rates[2] == CONFIG.lr
    assert all(a > b for a, b in zip(rates[2:], rates[3:], strict=False)) and rates[-1] > 0


def test_a_batch_without_any_label_changes_little(images):
    torch.manual_seed(0)
    state = training.new_state(TINY, CONFIG, None, "cpu")
    batch = [torch.zeros(2, 64, 64, 3, dtype=torch.uint8), torch.zeros(2, 32, 32, dtype=torch.uint8)]
    weights = torch.ones(14)
    weights[0] = 0
    assert training.train_step(state, batch, weights, CONFIG, Ranks()) == 0
    assert all(torch.isfinite(p).all() for p in state.model.parameters())


def test_temperature_undoes_a_known_scaling(images):
    """Logits that are log-likelihoods of the labels drawn from them, times 3: the temperature is 3."""

    class Fake:
        def __init__(self):
            self.rng = np.random.default_rng(0)

        def logits(self, rgb, depth):
            return 3 * self.answers.pop(0)

        answers: list = []

    fake, data, rng = Fake(), [], np.random.default_rng(1)
    for _ in range(6):
        z = rng.normal(0, 1.5, (32, 32, 14)).astype(np.float32)
        p = np.exp(z[..., 1:])
        p /= p.sum(axis=2, keepdims=True)
        label = 1 + (p.cumsum(axis=2) < rng.random((32, 32, 1))).sum(axis=2).clip(max=12)
        fake.answers.append(z)
        data.append(Example(np.zeros((32, 32, 3), np.uint8), label.astype(np.uint8)))
    answers = list(fake.answers)
    assert abs(fit_temperature(fake, data) - 3) < 0.15
    # A second set whose logits are right as they are: one temperature between, where both are equally wrong.
    fake.answers = [*answers, *[z / 3 for z in answers]]
    assert 1.2 < fit_temperature(fake, data, data) < 2.6


def test_score_matches_a_hand_count(images):
    model = DSNet(TINY).eval()
    segmenter = DSNetSegmenter(model, WeightsInfo(TINY, size=(64, 64)))
    data = LabelledImages(open_set(images), progress=False)
    right = total = 0
    for example in (data[i] for i in range(len(data))):
        enlarged = cv2.resize(segmenter.predict(example.rgb), (64, 64), interpolation=cv2.INTER_LINEAR)
        right += (enlarged[..., 1:].argmax(axis=2) + 1 == example.label).sum()
        total += example.label.size
    assert score(segmenter, data)["pixel_acc"] == pytest.approx(right / total)


@pytest.mark.parametrize(("name", "shape"), [("dsnet", DSNetConfig()), (None, DSNetPConfig("lite2"))])
def test_shipped_weights_label_a_frame(name, shape):
    segmenter = load_segmenter(name)
    assert dataclasses.replace(segmenter.info.config, dropout=shape.dropout) == shape
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8), (0, 0), 9)
    probabilities = segmenter(Frame(0, 0.0, image, np.ones((240, 320), np.float32)))
    width, height = fitting_size(segmenter.info.size, 320, 240)
    assert probabilities.shape == (height // 2, width // 2, 14) and probabilities.dtype == np.float32
    np.testing.assert_allclose(probabilities.sum(axis=2), 1, atol=1e-5)
    assert probabilities[..., 0].max() < 0.5  # void is never learnt


def test_the_command_trains_resumes_and_names_bad_input(images, tmp_path, capsys):
    flags = "--steps 2 --batch 2 --size 64 64 --workers 0 --net.layers 1 --net.growth 4 --net.stem-convs 1"
    argv = ["--data", str(images), "--val", str(images), "--out", str(tmp_path / "run"), *flags.split()]
    assert cli.run("train", argv) == 0
    assert "class average" in capsys.readouterr().out
    assert cli.run("train", argv) == 2
    assert "--resume" in capsys.readouterr().err
    assert cli.run("train", [*argv, "--resume"]) == 0
    assert cli.run("train", ["--data", str(tmp_path), *argv[2:], "--resume"]) == 2
    assert "no labelled image" in capsys.readouterr().err


def test_weights_may_work_at_another_size_than_they_were_trained_at(images, tmp_path):
    config = dataclasses.replace(CONFIG, steps=2, validate_every=2, working_size=(96, 64))
    run(images, tmp_path / "run", config)
    assert load_weights(tmp_path / "run" / "best.safetensors")[1].size == (96, 64)
    with pytest.raises(InputError, match="multiples of 32"):
        dataclasses.replace(CONFIG, working_size=(100, 64))
