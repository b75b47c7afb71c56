"""What a training step sees: a function of the seed and the step only."""

import numpy as np
from torch.utils.data import Dataset

from dsmap.dsnet.augment import augment
from dsmap.dsnet.config import AugmentConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages


class AugmentedStream(Dataset):
    """Sample k of the whole training, k = 0 .. steps * batch - 1: the data shuffled anew every epoch.

    A sample is (rgb, label) or, `with_depth`, (rgb, label, depth), as `augment` gives them.
    """

    def __init__(
        self,
        images: LabelledImages,
        augmentation: AugmentConfig,
        config: TrainConfig,
        with_depth: bool = False,
    ):
        self.images, self.augmentation, self.config = images, augmentation, config
        self.with_depth = with_depth

    def __len__(self) -> int:
        return self.config.steps * self.config.batch

    def __getitem__(self, k: int) -> tuple[np.ndarray, ...]:
        epoch, position = divmod(k, len(self.images))
        order = np.random.default_rng((self.config.seed, 0, epoch)).permutation(len(self.images))
        rng = np.random.default_rng((self.config.seed, 1, k))
        view = augment(self.images[int(order[position])], self.config.size, self.augmentation, rng)
        if self.with_depth and view.depth is not None:
            return view.rgb, view.label, view.depth
        return view.rgb, view.label
