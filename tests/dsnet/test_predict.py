"""Measuring a network: ranks, reliability, and the pictures that `dsmap evaluate --data` draws."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from dsmap.dsnet.checkpoint import WeightsInfo, save_weights  # noqa: E402
from dsmap.dsnet.config import DSNetConfig  # noqa: E402
from dsmap.dsnet.datasets.base import Example  # noqa: E402
from dsmap.dsnet.inference.predict import fitting_size  # noqa: E402
from dsmap.dsnet.networks.dsnet import DSNet  # noqa: E402
from dsmap.dsnet.scoring.measure import Watch, by_rank  # noqa: E402
from dsmap.dsnet.scoring.pictures import draw_overlays, draw_reliability  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.frame import Intrinsics  # noqa: E402
from dsmap.metrics import Reliability  # noqa: E402
from dsmap.sequences import SequenceWriter  # noqa: E402
from dsmap.tools import cli  # noqa: E402

TINY = DSNetConfig(layers=1, growth=4, widths=(4, 4, 4, 4), stem_convs=1)


@pytest.fixture
def images(tmp_path):
    """Twelve labelled images and weights."""
    rng = np.random.default_rng(0)
    for name in ("set/rgb", "set/label"):
        (tmp_path / name).mkdir(parents=True)
    for i in range(12):
        label = np.zeros((48, 64), np.uint8)
        label[4:, : 32 + i] = 1 + i
        label[4:, 32 + i :] = 12
        cv2.imwrite(str(tmp_path / f"set/label/{i:04d}.png"), label)
        cv2.imwrite(str(tmp_path / f"set/rgb/{i:04d}.png"), rng.integers(0, 256, (48, 64, 3), np.uint8))
    torch.manual_seed(0)
    save_weights(tmp_path / "net.safetensors", DSNet(TINY), WeightsInfo(TINY, (64, 64)))
    return tmp_path


def test_evaluate_writes_scores_and_pictures(images, capsys):
    argv = ["--data", str(images / "set"), "--weights", str(images / "net.safetensors"), "--out"]
    assert cli.run("evaluate", [*argv, str(images / "out")]) == 0
    assert "overlays.jpg" in capsys.readouterr().out
    metrics = json.loads((images / "out" / "metrics.json").read_text())
    ranked = metrics["images_by_rank"]
    assert len(ranked) == 12 and {image["index"] for image in ranked} == set(range(12))
    averages = [image["class_avg"] for image in ranked]
    assert averages == sorted(averages, reverse=True)
    reliability = cv2.imread(str(images / "out" / "reliability.png"))
    overlays = cv2.imread(str(images / "out" / "overlays.jpg"))
    assert reliability.std() > 10 and overlays.std() > 10
    assert overlays.shape[1] == 1560 and overlays.shape[0] > 900  # two blocks of five rows of three
    assert not list((images / "out").glob(".*"))
    assert cli.run("evaluate", [*argv, str(images / "only.json")]) == 0
    assert json.loads((images / "only.json").read_text()) == metrics
    assert not (images / "reliability.png").exists()


def test_the_engine_is_an_option_and_makes_no_difference(images):
    argv = ["--data", str(images / "set"), "--weights", str(images / "net.safetensors"), "--out"]
    scores = {}
    for engine in ("auto", "torch"):
        assert cli.run("evaluate", [*argv, str(images / f"{engine}.json"), "--engine", engine]) == 0
        scores[engine] = json.loads((images / f"{engine}.json").read_text())["single_frame"]
    assert scores["auto"]["pixel_acc"] == pytest.approx(scores["torch"]["pixel_acc"], abs=1e-2)
    assert scores["auto"]["ece"] == pytest.approx(scores["torch"]["ece"], abs=1e-2)


def test_evaluate_shows_the_network_geometry_unless_it_is_told_not_to(tmp_path):
    """Grey images: only depth tells left from right; a prior that is asked for is in the scores."""
    camera, config = Intrinsics(64, 64, 60.0, 60.0, 31.5, 31.5), dataclasses.replace(TINY, channels=7)
    label = np.full((64, 64), 12, np.uint8)
    label[:, 32:] = 4
    with SequenceWriter(tmp_path / "seq", camera, depth_scale=5000.0) as writer:
        writer.write(0.0, np.full((64, 64, 3), 120, np.uint8), np.where(label == 4, 1.0, 3.0), label=label)
    torch.manual_seed(0)
    shares = (0.0, *np.full(13, 1 / 13))
    info = WeightsInfo(config, (64, 64), shares=shares, balance=(0.0, *[1.0] * 13), prior=0.5)
    save_weights(tmp_path / "net.safetensors", DSNet(config), info)
    argv = ["--data", str(tmp_path / "seq"), "--weights", str(tmp_path / "net.safetensors"), "--out"]
    found = {}
    for name, flags in {"rgbd": [], "rgb": ["--colour-only"], "prior": ["--prior", "1"]}.items():
        assert cli.run("evaluate", [*argv, str(tmp_path / f"{name}.json"), *flags]) == 0
        found[name] = json.loads((tmp_path / f"{name}.json").read_text())
    assert [found[name]["geometry"] for name in ("rgbd", "rgb")] == [True, False]
    assert [found[name]["prior"] for name in ("rgbd", "prior")] == [0.5, 1]
    assert found["rgbd"]["single_frame"]["brier"] != found["rgb"]["single_frame"]["brier"]
    assert cli.run("evaluate", [*argv, str(tmp_path / "x.json"), "--prior", "2"]) == 2


@pytest.mark.parametrize(
    ("working", "image", "expected"),
    [
        ((416, 320), (640, 480), (416, 320)),  # nearly the same shape: stretched a little
        ((416, 320), (1280, 720), (480, 256)),
        ((416, 320), (480, 640), (320, 416)),
        ((416, 320), (512, 512), (352, 352)),
        ((320, 256), (640, 480), (320, 256)),
        ((448, 448), (640, 480), (512, 384)),
    ],
)
def test_the_working_size_fits_the_frame(working, image, expected):
    width, height = fitting_size(working, *image)
    assert width % 32 == height % 32 == 0 and width * height <= working[0] * working[1]
    assert (width, height) == expected


def test_images_are_shown_by_rank_and_not_by_taste():
    assert by_rank(92) == [0, 1, 2, 44, 45, 46, 47, 89, 90, 91]
    assert by_rank(11) == [0, 1, 2, 3, 4, 5, 6, 8, 9, 10]
    assert by_rank(4) == [0, 1, 2, 3]


def test_a_watch_scores_each_image_and_passes_answers_on():
    """Half of one image right, all of another, nothing to score in a third."""
    p = np.zeros((4, 4, 14), np.float32)
    p[..., 5] = 0.8
    p[..., 1] = 0.2
    watch = Watch(lambda rgb, geometry: p)
    half = np.full((8, 8), 5, np.uint8)
    half[:4] = 12
    for index, label in enumerate((half, np.full((8, 8), 5, np.uint8), np.zeros((8, 8), np.uint8))):
        assert watch(index, Example(np.zeros((8, 8, 3), np.uint8), label)) is p
    assert [(s.index, s.class_avg, s.pixel_acc) for s in watch.ranked()] == [(1, 1.0, 1.0), (0, 0.5, 0.5)]
    assert watch.reliability.ece() == pytest.approx(abs(96 / 128 - 0.8))


def test_pictures_of_nothing(tmp_path):
    draw_reliability(tmp_path / "r.png", Reliability())
    assert cv2.imread(str(tmp_path / "r.png")) is not None
    with pytest.raises(InputError, match="no labelled image"):
        draw_overlays(tmp_path / "o.jpg", [], 0)
