"""Copy-paste (Ghiasi et al. 2021): an object of a rare class, cut by its label out of another training image."""

from collections.abc import Sequence

import cv2
import numpy as np

from dsmap.dsnet.data import LabelledImages
from dsmap.dsnet.datasets.base import Example

_STRUCTURE = frozenset({"void", "background", "ceiling", "floor", "wall"})
"""What the room itself is made of is no object: it is never cut out."""
LEAST, MOST = 0.004, 0.25
"""Share of its image that an object must cover to be cut out."""
SCALE = (0.7, 1.4)
"""Size of a pasted object relative to its own image."""
SHIFT = 0.15
"""How far it may move from its place, relative to the image: pictures stay high, chairs low."""


class Donors:
    """The images from which objects of the rarer half of the classes can be cut, set by set."""

    def __init__(self, data: LabelledImages):
        share = data.fractions.mean(axis=0)
        objects = [c for c, name in enumerate(data.class_names) if name not in _STRUCTURE and share[c] > 0]
        rarest_first = sorted(objects, key=lambda c: (share[c], c))
        self.data = data
        self.set_of = np.repeat(np.arange(len(data.sizes)), data.sizes)
        self.images: list[dict[int, np.ndarray]] = []
        """Of each data set, the images that show enough of a class, by class."""
        for number in range(len(data.sizes)):
            inside = self.set_of == number
            of_class = {
                c: np.flatnonzero(inside & (data.fractions[:, c] >= LEAST))
                for c in rarest_first[: (len(rarest_first) + 1) // 2]
            }
            self.images.append({c: found for c, found in of_class.items() if len(found)})

    def paste_into(self, index: int, rng: np.random.Generator) -> Example:
        """Image `index` with an object of another image of the same data set in it.

        The class is drawn first, each rare class alike; the image as it is where no object is found.
        """
        example = self.data[index]
        of_class = self.images[self.set_of[index]]
        if not of_class:
            return example
        chosen = int(rng.choice(list(of_class)))
        donor = int(rng.choice(of_class[chosen]))
        if donor == index:
            return example
        source = self.data[donor]
        mask = pick_object(source.label, chosen, rng)
        return example if mask is None else paste(example, source, mask, rng)


def pick_object(label: np.ndarray, chosen: int, rng: np.random.Generator) -> np.ndarray | None:
    """One connected region of a class, bool (H, W), a random one of those that are large enough; None: none is."""
    _, regions, stats, _ = cv2.connectedComponentsWithStats((label == chosen).astype(np.uint8))
    area = stats[:, cv2.CC_STAT_AREA] / label.size
    area[0] = 0  # what is not of the class
    large = np.flatnonzero((area >= LEAST) & (area <= MOST))
    return regions == int(rng.choice(large)) if len(large) else None


def paste(target: Example, source: Example, mask: np.ndarray, rng: np.random.Generator) -> Example:
    """The part of `source` under a mask put into `target`, about where it was, flipped and scaled at random.

    Colour, label and geometry (where both images have it) change at the same pixels.
    """
    height, width = target.label.shape
    h, w = mask.shape
    scale = np.exp(rng.uniform(*np.log(SCALE)))
    fit = min(width / w, height / h)
    rows, columns = np.nonzero(mask)
    # About the middle of the object, in pixels of the target; the place relative to the image is kept.
    middle = np.array([columns.mean(), rows.mean()])
    place = (middle + 0.5) / (w, h)
    flip = rng.random() < 0.5
    if flip:
        place[0] = 1 - place[0]
    place = np.clip(place + rng.uniform(-SHIFT, SHIFT, 2), 0, 1) * (width, height) - 0.5
    A = np.array([[-scale * fit if flip else scale * fit, 0.0, 0.0], [0.0, scale * fit, 0.0]])
    A[:, 2] = place - A[:, :2] @ middle

    def warped(values: np.ndarray, how: int) -> np.ndarray:
        return cv2.warpAffine(values, A, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE)

    inside = cv2.warpAffine(mask.astype(np.uint8), A, (width, height), flags=cv2.INTER_NEAREST) > 0
    rgb = np.where(inside[..., None], warped(source.rgb, cv2.INTER_LINEAR), target.rgb)
    label = np.where(inside, source.label[mask][0], target.label)
    geometry = target.geometry
    if geometry is not None and source.geometry is not None:
        pasted = warped(source.geometry.astype(np.float32), cv2.INTER_NEAREST)
        geometry = np.where(inside[..., None], pasted, geometry).astype(np.float16)
    return Example(rgb, label, geometry)


def paste_sometimes(
    data: LabelledImages, donors: Donors | None, index: int, probability: float, key: Sequence[int]
) -> Example:
    """Image `index`, with that probability with an object pasted in; `key` determines all of it."""
    rng = np.random.default_rng(tuple(key))
    if donors is None or rng.random() >= probability:
        return data[index]
    return donors.paste_into(index, rng)
