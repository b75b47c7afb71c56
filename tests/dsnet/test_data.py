"""Labelled images: what is found, what is refused, and that augmentation keeps image and label together."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from dsmap.classes import VOID
from dsmap.dsnet.config import AugmentConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages, class_weights
from dsmap.dsnet.datasets.base import Example
from dsmap.dsnet.datasets.registry import open_set, open_sets
from dsmap.dsnet.training.augment import augment, degrade_geometry, jitter_colour, random_affine, warp_image
from dsmap.dsnet.training.sample_stream import AugmentedStream
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import SequenceWriter

GEOMETRY_ONLY = AugmentConfig(
    brightness=0, contrast=0, gamma=0, white_balance=0, saturation=0, hue=0, blur=0, noise=0
)
NOTHING = AugmentConfig(
    scale=(1, 1), aspect=0, rotate=0, flip=0, brightness=0, contrast=0, gamma=0, white_balance=0,
    saturation=0, hue=0, blur=0, noise=0,
)  # fmt: skip


def folder_of_images(path, names=("0001", "0002"), size=(24, 32)):
    """An NYUv2-like folder; image k is grey 10 k, its label class k + 1."""
    (path / "rgb").mkdir(parents=True)
    (path / "label").mkdir()
    for k, name in enumerate(names):
        cv2.imwrite(str(path / "rgb" / f"{name}.png"), np.full((*size, 3), 10 * k, np.uint8))
        cv2.imwrite(str(path / "label" / f"{name}.png"), np.full(size, k + 1, np.uint8))
    return path


def recording(path, labelled=(0, 2)):
    """A sequence of three frames of which some have labels."""
    camera = Intrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
    with SequenceWriter(path, camera, depth_scale=1000.0) as writer:
        for k in range(3):
            label = np.full((24, 32), k + 1, np.uint8) if k in labelled else None
            writer.write(k / 30, np.full((24, 32, 3), 10 * k, np.uint8), np.ones((24, 32)), label=label)
    return path


def test_folder_of_images_and_labels(tmp_path):
    data = LabelledImages(open_set(folder_of_images(tmp_path / "set")), progress=False)
    assert len(data) == 2
    example = data[1]
    assert example.rgb.shape == (24, 32, 3) and (example.rgb == 10).all() and (example.label == 2).all()
    assert example.geometry is None and not data.with_geometry


def test_frames_of_a_recording_without_labels_are_left_out(tmp_path):
    data = LabelledImages(open_set(recording(tmp_path / "seq")), progress=False)
    assert [int(data[i].label.max()) for i in range(len(data))] == [1, 3]


def test_geometry_is_made_if_wanted(tmp_path):
    data = open_set(recording(tmp_path / "seq"))
    assert LabelledImages(data, progress=False)[0].geometry is None
    geometry = LabelledImages(data, with_geometry=True, progress=False)[0].geometry
    assert geometry.shape == (24, 32, 4) and geometry.dtype == np.float16
    inner = geometry[4:-4, 4:-4]
    assert (inner[..., 3] == 1).all() and np.ptp(inner[..., 0]) < 0.01  # a plane in front of the camera


def test_folder_of_folders_in_a_fixed_order(tmp_path):
    recording(tmp_path / "all" / "b")
    folder_of_images(tmp_path / "all" / "a")
    (tmp_path / "all" / "empty").mkdir()
    items = open_set(tmp_path / "all").items
    assert [item.rgb.parent.parent.name for item in items] == ["a", "a", "b", "b"]


def test_a_small_cache_changes_nothing(tmp_path):
    data = open_set(folder_of_images(tmp_path / "set", names="abcd"))
    whole = LabelledImages(data, progress=False)
    part = LabelledImages(data, cache_bytes=2 * 24 * 32 * 4, progress=False)
    assert (len(whole._cache), len(part._cache)) == (4, 2)
    for i in range(4):
        np.testing.assert_array_equal(whole[i].rgb, part[i].rgb)
        np.testing.assert_array_equal(whole[i].label, part[i].label)


def test_missing_and_damaged_data_is_named(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        open_set(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no labelled image"):
        open_set(tmp_path)
    folder = folder_of_images(tmp_path / "set")
    (folder / "rgb" / "0002.png").unlink()
    with pytest.raises(InputError, match=r"0002.png: no image of this stem"):
        open_set(folder)


def test_a_bad_label_is_named_before_training(tmp_path):
    folder = folder_of_images(tmp_path / "set")
    label = folder / "label" / "0002.png"
    cv2.imwrite(str(label), np.full((24, 32), 40, np.uint8))
    with pytest.raises(InputError, match=r"0002.png: class id 40 found, expected 0..13"):
        LabelledImages(open_set(folder), progress=False)
    cv2.imwrite(str(label), np.ones((20, 32), np.uint8))
    with pytest.raises(InputError, match=r"0002.png: size is 32x20, expected 32x24"):
        LabelledImages(open_set(folder), progress=False)
    label.write_bytes(label.read_bytes()[:40])
    with pytest.raises(InputError, match=r"0002.png"):
        LabelledImages(open_set(folder), progress=False)


def test_class_weights_follow_their_formulas(tmp_path):
    folder = folder_of_images(tmp_path / "set", names="ab")
    half = np.full((24, 32), 1, np.uint8)
    half[:6] = 2
    half[6:12] = VOID
    cv2.imwrite(str(folder / "label" / "a.png"), half)  # class 1: 1/2, class 2: 1/4, void: 1/4 of it
    cv2.imwrite(str(folder / "label" / "b.png"), np.full((24, 32), 2, np.uint8))  # class 2: all of it
    data = LabelledImages(open_set(folder), progress=False)
    # frequency where present: class 1 1/2, class 2 (1/4 + 1) / 2 = 5/8; median 9/16
    expected = np.zeros(14)
    expected[1:3] = 9 / 16 / np.array([1 / 2, 5 / 8])
    np.testing.assert_allclose(class_weights(data, "median"), expected, rtol=1e-6)
    expected[1:3] = 1 / np.log(1.02 + np.array([0.5, 1.25]) / 1.75)
    np.testing.assert_allclose(class_weights(data, "log"), expected, rtol=1e-6)
    assert class_weights(data, "none").tolist() == [0, 1, 1] + [0] * 11


def test_without_augmentation_the_whole_image_is_resized():
    rng = np.random.default_rng(0)
    rgb = cv2.GaussianBlur(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8), (0, 0), 4)
    label = rng.integers(0, 14, (48, 64), dtype=np.uint8)
    view = augment(Example(rgb, label), (64, 48), NOTHING, rng)
    labels = view.label
    np.testing.assert_array_equal(view.rgb, rgb)
    assert labels.shape == (24, 32)
    # A pixel of half the size lies between four: its label is one of theirs.
    around = [label[i::2, j::2] for i in (0, 1) for j in (0, 1)]
    assert np.any([a == labels for a in around], axis=0).all()


@pytest.mark.parametrize("seed", range(8))
def test_augmentation_keeps_image_and_label_aligned(seed):
    """Regions of constant grey 18 k carry the label k; wherever the result is not mixed it must still do."""
    rng = np.random.default_rng(seed)
    blocks = rng.integers(1, 13, (6, 8), dtype=np.uint8)
    label = np.kron(blocks, np.ones((40, 40), np.uint8))
    rgb = np.repeat(18 * label[..., None], 3, axis=2)
    view = augment(Example(rgb, label), (256, 192), GEOMETRY_ONLY, rng)
    image, labels = view.rgb, view.label
    grey = np.float32(image[..., 0]) / 18
    grey[image[..., 0] == 127] = VOID  # outside the given image
    quads = np.stack([grey[i::2, j::2] for i in (0, 1) for j in (0, 1)])
    unmixed = (quads.max(axis=0) - quads.min(axis=0) < 0.01) & (np.abs(quads[0] - quads[0].round()) < 0.06)
    assert unmixed.mean() > 0.5
    wrong = unmixed & (labels != quads[0].round())
    assert wrong.sum() <= 0.002 * unmixed.sum()  # a blurred edge may pass another grey level
    assert len(np.unique(labels)) > 3


KEPT = {"drop_geometry": 0.0, "holes": 0.0, "geometry_noise": 0.0}


def columns(height=48, width=64):
    """An example whose colour and whose inverse depth both tell the column."""
    x = np.broadcast_to(np.arange(1, width + 1, dtype=np.float32), (height, width))
    geometry = np.stack([x / 32, 0 * x, 0 * x, 1 + 0 * x], axis=2).astype(np.float16)
    rgb = np.repeat(x[..., None].astype(np.uint8) * 3, 3, axis=2)
    return Example(rgb, np.ones((height, width), np.uint8), geometry)


def test_geometry_is_cropped_with_the_image_and_keeps_its_values():
    rng = np.random.default_rng(0)
    view = augment(columns(), (64, 48), replace(NOTHING, scale=(2.0, 2.0), flip=1.0, **KEPT), rng)
    assert view.geometry.shape == (48, 64, 4) and view.geometry.dtype == np.float16
    shown = view.rgb[..., 0].astype(float) / 3  # the column that colour says
    assert np.abs(32 * view.geometry[..., 0] - shown).max() <= 1.1 and 25 < np.ptp(shown) < 40
    outside = augment(columns(), (64, 48), replace(NOTHING, scale=(0.5, 0.5), **KEPT), rng)
    assert (outside.geometry[..., 3] == 0).mean() > 0.7 and outside.geometry[..., 3].max() == 1


def test_geometry_that_is_dropped_is_zero_everywhere():
    rng = np.random.default_rng(0)
    view = augment(columns(), (64, 48), replace(NOTHING, **KEPT | {"drop_geometry": 1.0}), rng)
    assert view.geometry.shape == (48, 64, 4) and not view.geometry.any() and view.rgb.any()


def test_holes_stay_holes_and_new_ones_are_empty_in_all_channels():
    given = columns().geometry.astype(np.float32)
    given[10:20, 10:30] = 0
    config, left = AugmentConfig(drop_geometry=0.0, holes=1.0, geometry_noise=1.0), []
    for seed in range(20):
        got = degrade_geometry(given.copy(), config, np.random.default_rng(seed))
        there = got[..., 3] > 0
        assert not there[10:20, 10:30].any() and there.sum() <= (given[..., 3] > 0).sum()
        assert not got[~there].any() and set(np.unique(got[..., 3])) <= {0, 1}
        assert there.sum() < 10 or np.abs(got[there] - given[there]).max() > 0.01  # noise
        left.append(there.mean())
    assert np.ptp(left) > 0.3 and np.mean(left) > 0.2  # some lose little, some much


def test_a_stream_without_depth_has_empty_geometry(tmp_path):
    data = LabelledImages(open_set(folder_of_images(tmp_path / "set")), with_geometry=True, progress=False)
    stream = AugmentedStream(data, NOTHING, TrainConfig(size=(64, 32)), with_geometry=True)
    rgb, label, geometry = stream[0]
    assert rgb.shape == (32, 64, 3) and label.shape == (16, 32)
    assert geometry.shape == (32, 64, 4) and geometry.dtype == np.float16 and not geometry.any()


def test_zoom_stays_inside_and_flip_mirrors():
    rng = np.random.default_rng(3)
    config = AugmentConfig(scale=(1.5, 2.0), rotate=0, flip=1.0)
    for _ in range(20):
        A = random_affine((64, 48), (96, 96), config, rng)
        corners = np.linalg.inv(A) @ np.array([[0, 95, 0, 95], [0, 0, 95, 95], [1, 1, 1, 1.0]])
        assert corners[0].min() > -0.6 and corners[0].max() < 63.6
        assert corners[1].min() > -0.6 and corners[1].max() < 47.6
        assert A[0, 0] < 0 < A[1, 1]


def test_shrinking_averages_instead_of_aliasing():
    stripes = np.zeros((128, 128, 3), np.uint8)
    stripes[:, ::2] = 255
    small = warp_image(stripes, np.diag([1 / 3, 1 / 3, 1.0]), (40, 40))
    assert small[5:-5, 5:-5].std() < 12


def test_colour_changes_are_deterministic_and_grey_stays_grey_without_white_balance():
    config = AugmentConfig(white_balance=0)
    grey = np.repeat(np.random.default_rng(0).integers(60, 190, (8, 8, 1), dtype=np.uint8), 3, axis=2)
    a, b = (jitter_colour(grey, config, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(a, b)
    assert np.ptp(a.astype(int), axis=2).max() <= 2
    assert np.abs(a.astype(int) - grey).max() > 5
    np.testing.assert_array_equal(jitter_colour(grey, NOTHING, np.random.default_rng(5)), grey)


@pytest.mark.parametrize("wrong", [{"size": (100, 64)}, {"steps": 0}, {"lr": 0.0}, {"ema": 1.0}])
def test_impossible_training_settings_are_named(wrong):
    with pytest.raises(InputError, match="training"):
        TrainConfig(**wrong)


def test_class_weights_of_shares_count_what_is_drawn(tmp_path):
    """Two sets of one class each: drawn 1 : 3, the first class is the rarer however many images it has."""
    first = folder_of_images(tmp_path / "a", names=("0001",))
    second = folder_of_images(tmp_path / "b", names=("0001", "0002"))
    data = LabelledImages(open_sets([first, second]), progress=False)
    assert data.sizes == (1, 2)
    # By size, class 1 has 2 of 3 images; drawn 1 : 3 it has 0.25 + 0.75 / 2 = 0.625, class 2 0.375.
    for shares, share in (((), 2 / 3), ((1.0, 3.0), 0.625)):
        weights = class_weights(data, "inverse", shares)
        np.testing.assert_allclose(weights[1] * share, weights[2] * (1 - share), rtol=1e-6)


def test_shares_say_how_often_each_set_is_drawn_from(tmp_path):
    first = folder_of_images(tmp_path / "a", names=("0001",))
    second = folder_of_images(tmp_path / "b", names=("0001", "0002"))
    data = LabelledImages(open_sets([first, second]), progress=False)
    config = TrainConfig(steps=100, batch=10, size=(32, 32), shares=(0.2, 0.8))
    stream = AugmentedStream(data, NOTHING, config)
    chosen = [stream._image_of(k) for k in range(1000)]
    assert 0.15 < np.mean(np.array(chosen) == 0) < 0.25 and set(chosen) == {0, 1, 2}
    with pytest.raises(InputError, match="3 shares, expected one for each of 2"):
        AugmentedStream(data, NOTHING, replace(config, shares=(1.0, 1.0, 1.0)))
