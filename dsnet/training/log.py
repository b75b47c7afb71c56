"""Logs of a training for TensorBoard, where it is installed."""

import sys
from pathlib import Path

import numpy as np

from dsmap.classes import PALETTE
from dsmap.dsnet.data import LabelledImages
from dsmap.dsnet.inference.predict import DSNetSegmenter
from dsmap.sequences.images import resize_nearest

EVERY = 10
"""Steps between two points of the loss."""
OVERLAYS = 4
"""Validation images whose answers are shown."""


class Log:
    """Events in a folder; nothing is written (and one sentence said) without the library."""

    def __init__(self, folder: Path, step: int = 0, wanted: bool = True):
        self.writer = None
        if not wanted:
            return
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            print("no TensorBoard log; install it with: pip install 'dsmap[train]'", file=sys.stderr)
            return
        self.writer = SummaryWriter(str(folder), purge_step=step)

    def step(self, step: int, loss: float, lr: float) -> None:
        """Note a training step."""
        if self.writer is not None and step % EVERY == 0:
            self.writer.add_scalar("train/loss", loss, step)
            self.writer.add_scalar("train/lr", lr, step)

    def validation(self, record: dict, segmenter: DSNetSegmenter, data: LabelledImages) -> None:
        """Note the scores of a validation, class by class, and show some answers over their images."""
        if self.writer is None:
            return
        step = record["step"]
        for name in ("class_avg", "miou", "pixel_acc"):
            self.writer.add_scalar(f"val/{name}", record[name], step)
        for name, values in record["per_class"].items():
            self.writer.add_scalar(f"val_recall/{name}", values["recall"], step)
            self.writer.add_scalar(f"val_iou/{name}", values["iou"], step)
        for i in np.linspace(0, len(data) - 1, min(OVERLAYS, len(data))).astype(int):
            example = data[int(i)]
            answer = (
                segmenter.predict(example.rgb, example.geometry)[..., 1:].argmax(axis=2).astype(np.uint8) + 1
            )
            answer = resize_nearest(answer, example.rgb.shape[1], example.rgb.shape[0])
            picture = (np.float32(example.rgb) + PALETTE[answer % len(PALETTE)]) / 2
            self.writer.add_image(f"val/{i}", picture.astype(np.uint8), step, dataformats="HWC")
        self.writer.flush()

    def close(self) -> None:
        """Write what is left."""
        if self.writer is not None:
            self.writer.close()
