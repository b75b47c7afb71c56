"""Tiny data sets for the experiments: CIFAR-10, VOC 2012, NYUv2 in miniature."""

import cv2
import numpy as np

from dsmap.dsnet.datasets.cifar import CIFAR_CLASSES, ClassifiedImages


def coloured(count=200, seed=0):
    """Images whose colour tells the class."""
    rng = np.random.default_rng(seed)
    labels = (np.arange(count) % 10).astype(np.uint8)
    palette = np.random.default_rng(9).integers(0, 256, (10, 3))
    images = palette[labels][:, None, None] + rng.normal(0, 20, (count, 32, 32, 3))
    return ClassifiedImages(np.clip(images, 0, 255).astype(np.uint8), labels)


def write_cifar(path, count=200):
    data = coloured(count)
    for k, (image, label) in enumerate(zip(data.images, data.labels, strict=True)):
        folder = path / "train" / CIFAR_CLASSES[label]
        folder.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"{k:04}.png"), image[..., ::-1])
    return path


def write_voc(path, count=10, official=False):
    rng = np.random.default_rng(0)
    for name in ("JPEGImages", "SegmentationClassAug"):
        (path / name).mkdir(parents=True)
    for k in range(count):
        mask = np.zeros((40, 50), np.uint8)
        mask[10:30, 5:40] = 1 + k % 3
        mask[0] = 255
        image = np.clip(60 * (mask[..., None] % 4) + rng.normal(0, 9, (40, 50, 3)), 0, 255).astype(np.uint8)
        cv2.imwrite(str(path / "JPEGImages" / f"i{k}.jpg"), image)
        cv2.imwrite(str(path / "SegmentationClassAug" / f"i{k}.png"), mask)
    if official:
        lists = path / "ImageSets" / "Segmentation"
        lists.mkdir(parents=True)
        (lists / "val.txt").write_text("i0\ni1\n")
    return path


def write_labelled(path, numbers, size=(48, 64)):
    """rgb/ and label/ of the 13 classes."""
    rng = np.random.default_rng(1)
    for name in ("rgb", "label"):
        (path / name).mkdir(parents=True)
    for number in numbers:
        label = np.full(size, 12, np.uint8)
        label[size[0] // 2 :] = rng.choice([1, 5, 9])
        image = np.clip(18 * label[..., None] + rng.normal(0, 5, (*size, 3)), 0, 255).astype(np.uint8)
        cv2.imwrite(str(path / "rgb" / f"{number:04}.png"), image)
        cv2.imwrite(str(path / "label" / f"{number:04}.png"), label)
    return path
