"""What a training step sees: a function of the seed and the step only."""

import numpy as np
from torch.utils.data import Dataset

from dsmap.dsnet.config import GEOMETRY_CHANNELS, AugmentConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages
from dsmap.dsnet.training.augment import augment
from dsmap.dsnet.training.copy_paste import Donors, paste_sometimes
from dsmap.errors import InputError


class AugmentedStream(Dataset):
    """Sample k of the whole training, k = 0 .. steps * batch - 1: the data shuffled anew every epoch.

    With `config.shares` each sample's data set is drawn first, then one of its images.

    A sample is (rgb, label) or, `with_geometry`, (rgb, label, geometry), as `augment` gives them; geometry is 0 where
    the data have no depth.
    """

    def __init__(
        self,
        images: LabelledImages,
        augmentation: AugmentConfig,
        config: TrainConfig,
        with_geometry: bool = False,
    ):
        self.images, self.augmentation, self.config = images, augmentation, config
        self.with_geometry = with_geometry
        self.donors = Donors(images) if augmentation.copy_paste > 0 else None
        if config.shares and len(config.shares) != len(images.sizes):
            raise InputError(
                f"training: {len(config.shares)} shares, expected one for each of {len(images.sizes)} data sets"
            )

    def __len__(self) -> int:
        return self.config.steps * self.config.batch

    def __getitem__(self, k: int) -> tuple[np.ndarray, ...]:
        rng = np.random.default_rng((self.config.seed, 1, k))
        key = (self.config.seed, 3, k)  # of its own: the rest is the same with it and without it
        example = paste_sometimes(
            self.images, self.donors, self._image_of(k), self.augmentation.copy_paste, key
        )
        view = augment(example, self.config.size, self.augmentation, rng)
        if not self.with_geometry:
            return view.rgb, view.label
        if view.geometry is None:
            return view.rgb, view.label, np.zeros((*view.rgb.shape[:2], GEOMETRY_CHANNELS), np.float16)
        return view.rgb, view.label, view.geometry

    def _image_of(self, k: int) -> int:
        """The number of sample k's image among all data sets' images."""
        if self.config.shares:
            rng = np.random.default_rng((self.config.seed, 2, k))
            shares = np.array(self.config.shares) / sum(self.config.shares)
            chosen = int(rng.choice(len(shares), p=shares))
            return sum(self.images.sizes[:chosen]) + int(rng.integers(self.images.sizes[chosen]))
        epoch, position = divmod(k, len(self.images))
        order = np.random.default_rng((self.config.seed, 0, epoch)).permutation(len(self.images))
        return int(order[position])
