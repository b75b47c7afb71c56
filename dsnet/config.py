"""Configuration of the network and of its training; free of torch, so that `--help` stays quick."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

from dsmap.classes import NUM_CLASSES
from dsmap.errors import InputError
from dsmap.ranges import Degrees, Range, Seed, Share

GEOMETRY_CHANNELS = 4
"""Inverse depth, angle to the vertical, height above the floor, and where they are known (`kernels.geometry`)."""


@dataclass(frozen=True)
class DSNetConfig:
    """Shape of a DS-Net; the defaults are the paper's Table 1 with the three-convolution stem of its text."""

    layers: Annotated[int | tuple[int, int, int, int], Range(1, 64)] = 4
    """L: 3x3 convolutions in a dense block (paper: 3, 4 or 5), or in each of B1..B4."""
    growth: Annotated[int | tuple[int, int, int, int], Range(1, 1024)] = 16
    """K: feature maps each of them adds (paper: 8, 16 or 32), or in each of B1..B4."""
    widths: Annotated[tuple[int, int, int, int], Range(1, 4096, length=4)] = (16, 16, 16, 16)
    """Channels that enter the pooling of B1..B4; the last is B4's output too, and D4..D1 mirror them."""
    stem_convs: Annotated[int, Range(1, 3)] = 3
    """3x3 convolutions before B1, the first with stride 2: 1 (Table 1) or 3 (the paper's text)."""
    final_relu: bool = False
    """ReLU after the last deconvolution, as in Table 1; off, so that logits may be negative."""
    dropout: Share = 0.2
    """Dropout after the 1x1 convolution of each B."""
    classes: Annotated[int, Range(1, 4096)] = NUM_CLASSES
    """Output channels: void and the classes of the data."""
    channels: Annotated[int, Range(3, 7)] = 3
    """Input channels: 3 (RGB) or 7 (RGB and geometry)."""

    def __post_init__(self) -> None:
        if self.channels not in (3, 3 + GEOMETRY_CHANNELS):
            raise InputError(f"DS-Net: channels is {self.channels}, expected 3 (RGB) or 7 (RGB and geometry)")
        if self.stem_convs not in (1, 3):
            raise InputError(f"DS-Net: stem_convs is {self.stem_convs}, expected 1 or 3")
        if len(self.widths) != 4 or any(len(pair) != 4 for pair in zip(*self.blocks, strict=True)):
            raise InputError(f"DS-Net: expected one number or four, one a block, and 4 widths, found {self}")
        if min(*self.widths, self.classes, *(min(block) for block in self.blocks)) < 1:
            raise InputError(f"DS-Net: layers, growth, classes and 4 widths must be positive, found {self}")
        if not 0 <= self.dropout < 1:
            raise InputError(f"DS-Net: dropout is {self.dropout}, expected 0 <= dropout < 1")

    @property
    def blocks(self) -> list[tuple[int, int]]:
        """(L, K) of B1..B4."""
        layers, growth = ((n,) * 4 if isinstance(n, int) else n for n in (self.layers, self.growth))
        return list(zip(layers, growth, strict=True))


@dataclass(frozen=True)
class DeconvNetConfig:
    """The deconvolution network of Noh, Hong and Han (ICCV 2015), VGG-16 mirrored."""

    width: Annotated[float, Range(0, 1, above=True)] = 1.0
    """Channels relative to the original (64 .. 512 and 4096); 1 has 252 million parameters."""
    classes: Annotated[int, Range(1, 4096)] = NUM_CLASSES
    channels: Annotated[int, Range(3, 7)] = 3

    def __post_init__(self) -> None:
        if not 0 < self.width <= 1 or self.channels not in (3, 7) or self.classes < 1:
            raise InputError(f"DeconvNet: expected 0 < width <= 1 and 3 or 7 channels, found {self}")


@dataclass(frozen=True)
class DSNetPConfig:
    """DS-Net's decoder on an encoder that was pre-trained on ImageNet."""

    encoder: Literal["lite0", "lite1", "lite2"] = "lite0"
    """Which EfficientNet-Lite."""
    widths: Annotated[tuple[int, int, int, int], Range(1, 4096, length=4)] = (128, 96, 80, 64)
    """Channels of the decoder at 1/32, 1/16, 1/8 and 1/4 of the size."""
    dropout: Share = 0.1
    """Dropout of whole feature maps before the last convolution."""
    classes: Annotated[int, Range(1, 4096)] = NUM_CLASSES
    """Output channels: void and the classes of the data."""
    channels: Annotated[int, Range(3, 7)] = 3 + GEOMETRY_CHANNELS
    """Input channels: 3 (RGB) or 7 (RGB and geometry)."""

    def __post_init__(self) -> None:
        if self.encoder not in ("lite0", "lite1", "lite2"):
            raise InputError(f"dsnet-p: encoder is {self.encoder!r}, expected lite0, lite1 or lite2")
        if self.channels not in (3, 3 + GEOMETRY_CHANNELS):
            raise InputError(
                f"dsnet-p: channels is {self.channels}, expected 3 (RGB) or 7 (RGB and geometry)"
            )
        if len(self.widths) != 4 or min(*self.widths, self.classes) < 1 or max(self.widths) > 4096:
            raise InputError(f"dsnet-p: expected 4 widths and classes from 1 to 4096, found {self}")
        if not 0 <= self.dropout < 1:
            raise InputError(f"dsnet-p: dropout is {self.dropout}, expected 0 <= dropout < 1")

    @property
    def geometry(self) -> bool:
        """Whether the network reads geometry."""
        return self.channels > 3


NetConfig = DSNetConfig | DSNetPConfig | DeconvNetConfig
"""Every network has `classes` and `channels`, and gives logits at half the size of its input."""

DSNETS: dict[str, DSNetConfig] = {
    "dsnet": DSNetConfig(),
    "dsnet-m": DSNetConfig(layers=5, growth=24, widths=(24, 48, 64, 96)),
    "dsnet-l": DSNetConfig(
        layers=(4, 6, 8, 8), growth=(16, 24, 32, 48), widths=(16, 48, 96, 192), dropout=0.1
    ),
    "dsnet-xl": DSNetConfig(layers=6, growth=48, widths=(32, 64, 128, 256)),
}
"""The paper's size, and wider and deeper nets of the same design for those with more compute."""


@dataclass(frozen=True)
class NetChoice:
    """Which network to train; what is not given is as the name says."""

    name: Literal["dsnet", "dsnet-m", "dsnet-l", "dsnet-xl", "dsnet-p", "deconvnet"] = "dsnet"
    """dsnet (the paper's size), dsnet-m, -l, -xl (wider and deeper), dsnet-p (pre-trained encoder), deconvnet (Noh et
    al.)."""
    geometry: bool | None = None
    """RGB-D: inverse depth, angle to the vertical and height above the floor as more channels; default: for dsnet-p.
    Images without depth are trained on with empty channels."""
    encoder: Literal["lite0", "lite1", "lite2"] | None = None
    """Which EfficientNet-Lite encodes in dsnet-p."""
    layers: Annotated[int | None, Range(1, 16)] = None
    """DS-Net's L: 3x3 convolutions in a dense block (paper: 3, 4 or 5)."""
    growth: Annotated[int | None, Range(1, 256)] = None
    """DS-Net's K: feature maps each of them adds (paper: 8, 16 or 32)."""
    widths: Annotated[tuple[int, int, int, int] | None, Range(1, 4096, length=4)] = None
    """DS-Net's channels at the pooling of B1..B4."""
    stem_convs: Annotated[int | None, Range(1, 3)] = None
    """DS-Net's 3x3 convolutions before B1: 1 or 3."""
    final_relu: bool | None = None
    """DS-Net's ReLU after the last deconvolution, as in Table 1."""
    dropout: Share | None = None
    """DS-Net's dropout after the 1x1 convolution of each B."""
    width: Annotated[float, Range(0, 8, above=True)] = 1.0
    """DeconvNet's channels relative to the original."""

    def config(self, classes: int = NUM_CLASSES) -> NetConfig:
        """The network for data of so many classes (void counts).

        Raises:
            InputError: options that the named network does not have, or an impossible shape.
        """
        wanted = self.name == "dsnet-p" if self.geometry is None else self.geometry
        channels = 3 + GEOMETRY_CHANNELS if wanted else 3
        if self.name == "dsnet-p":
            return self._pretrained(classes, channels)
        if self.encoder is not None:
            raise InputError(f"--net.name {self.name} has no encoder, expected dsnet-p for it")
        names = ("layers", "growth", "widths", "stem_convs", "final_relu", "dropout")
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if self.name in DSNETS:
            return replace(DSNETS[self.name], classes=classes, channels=channels, **given)
        if given:
            raise InputError(f"--net.name {self.name} has no {', '.join(given)}, expected a dsnet for these")
        return DeconvNetConfig(self.width, classes, channels)

    def _pretrained(self, classes: int, channels: int) -> "DSNetPConfig":
        given = {name: getattr(self, name) for name in ("encoder", "widths", "dropout")}
        given = {name: value for name, value in given.items() if value is not None}
        if self.layers or self.growth or self.stem_convs or self.final_relu is not None:
            raise InputError(
                "--net.name dsnet-p has no layers, growth, stem_convs, final_relu: expected none"
            )
        return DSNetPConfig(**given, classes=classes, channels=channels)


@dataclass(frozen=True)
class ClassifierConfig:
    """An encoder with global average pooling, for the paper's experiments on CIFAR-10."""

    encoder: DSNetConfig | DeconvNetConfig = DSNetConfig()
    """Whose encoder: its `classes` are the classes of the images."""
    stem_stride: int = 1
    """Of DS-Net's first convolution: 2 as in Table 1, or 1, which keeps more of a 32x32 image."""


@dataclass(frozen=True)
class AugmentConfig:
    """Strength of the random changes to a training image; 0 switches one off."""

    scale: Annotated[tuple[float, float], Range(0.05, 20, length=2)] = (0.9, 1.6)
    """Zoom of the image relative to fitting it to the training size, log-uniform."""
    aspect: Share = 0.1
    """Largest relative change of the aspect ratio."""
    rotate: Degrees = 5.0
    """Largest roll of the camera [degrees]."""
    flip: Share = 0.5
    """Probability of a left-right flip."""
    brightness: Share = 0.2
    """Largest relative change of brightness."""
    contrast: Share = 0.2
    """Largest relative change of contrast about the mean."""
    gamma: Annotated[float, Range(0, 3)] = 0.2
    """Largest change of log gamma."""
    white_balance: Share = 0.08
    """Largest relative change of one channel's gain."""
    saturation: Share = 0.3
    """Largest relative change of saturation."""
    hue: Degrees = 10.0
    """Largest rotation of hue [degrees]."""
    blur: Share = 0.1
    """Probability of a Gaussian blur (sigma up to 1.5 px)."""
    noise: Share = 0.2
    """Probability of Gaussian noise (sigma up to 12 grey levels)."""
    copy_paste: Share = 0.0
    """Probability that an object of a rarer class, cut by its label out of another image, is pasted in."""
    drop_geometry: Share = 0.2
    """Probability that an image comes without any geometry, so that the network serves colour alone as well."""
    holes: Share = 0.7
    """Probability that geometry has holes: patches, edges of things, all that is further than some distance."""
    geometry_noise: Share = 0.5
    """Probability that geometry is noisy and its floor is wrong by some centimetres."""

    def __post_init__(self) -> None:
        for name in ("copy_paste", "drop_geometry", "holes", "geometry_noise"):
            if not 0 <= getattr(self, name) <= 1:
                raise InputError(f"augmentation: {name} is {getattr(self, name)}, expected a probability")


@dataclass(frozen=True)
class TrainConfig:
    """One training run; with the data and the seed it determines the weights."""

    steps: Annotated[int, Range(1, 1_000_000_000)] = 4000
    """Optimiser steps of the whole schedule."""
    batch: Annotated[int, Range(1, 4096)] = 16
    """Images a step."""
    size: Annotated[tuple[int, int], Range(32, 4096, length=2)] = (448, 448)
    """Width and height of training images [px], multiples of 32."""
    working_size: Annotated[tuple[int, int] | None, Range(32, 4096, length=2)] = None
    """Width and height [px] of the whole images that are validated and that the weights are for; default: `size`.
    Where training zooms in, things look larger than in whole images of the same size: a larger one fits better."""
    lr: Annotated[float, Range(0, 100, above=True)] = 1e-2
    """Peak learning rate of AdamW."""
    weight_decay: Annotated[float, Range(0, 100)] = 1e-2
    """Decoupled weight decay of the convolutions."""
    warmup: Annotated[int, Range(0, 1_000_000_000)] = 100
    """Steps of linear warm-up before the cosine decay to zero."""
    ema: Share = 0.99
    """Decay of the averaged weights that are validated and saved; 0: no averaging."""
    balance: Literal["inverse", "median", "log", "none"] = "inverse"
    """Class weights: `inverse` (1 / share of pixels: what the class average asks for), `median` (median frequency
    within the images that show a class), `log` (1 / log(1.02 + share)) or `none`."""
    balance_power: Annotated[float, Range(0, 10)] = 0.75
    """Of `inverse`: weights are shares to the power of minus this; 1: best class average, 0.5: best mIoU, 0: best
    pixel accuracy."""
    validate_every: Annotated[int, Range(1, 1_000_000_000)] = 500
    """Steps between validations, which also write the checkpoint."""
    precision: Literal["fp32", "bf16"] = "fp32"
    """Of convolutions while training: bf16 is about twice as fast on processors (AVX512-BF16, AMX) and GPUs that
    have it. Weights, losses and batch norms stay fp32, validation is fp32."""
    shares: Annotated[tuple[float, ...], Range(0, 1e9)] = ()
    """How often each of the data sets is drawn from, in their order (0.3 0.7); default: by their sizes."""
    init_lr: Annotated[float, Range(0, 1000, above=True)] = 1.0
    """Learning rate of weights that come from `init`, relative to that of new ones (the paper: 1/8)."""
    encoder_lr: Annotated[float, Range(0, 1000, above=True)] = 1.0
    """Learning rate of a pre-trained encoder, relative to that of the rest."""
    freeze: Annotated[int, Range(0, 5)] = 0
    """Levels of a pre-trained encoder that stay as they are: 1 is its stem and all at 1/2 of the size, 2 up to 1/4."""
    imagenet: bool = True
    """Whether dsnet-p begins with ImageNet's weights, where no `init` is given (needs the extra `pretrained`)."""
    distil: Share = 0.7
    """With a teacher: share of the loss that follows its probabilities; the rest follows the labels."""
    smoothing: Share = 0.0
    """Label smoothing: this share of every target is spread over the classes."""
    prior: Share = 0.5
    """Class prior of the finished weights: 0 as frequent as in the data (best pixel accuracy), 1 all alike (best class
    average; what Eq. 5 divides by)."""
    seed: Seed = 0
    """Of initial weights, order, augmentation and dropout."""

    def __post_init__(self) -> None:
        for size in (self.size, self.working_size or self.size):
            if any(side % 32 or side < 32 for side in size):
                raise InputError(f"training: size is {size}, expected multiples of 32")
        if (
            min(self.steps, self.batch, self.validate_every) < 1
            or min(self.lr, self.init_lr) <= 0
            or not 0 <= self.ema < 1
        ):
            raise InputError(
                "training: steps, batch and validate-every must be at least 1, lr above 0, 0 <= ema < 1"
            )
        if not (
            self.encoder_lr > 0 and 0 <= self.freeze <= 5 and 0 <= self.smoothing < 1 and 0 <= self.prior <= 1
        ):
            raise InputError(
                "training: expected encoder-lr above 0, freeze of 0..5 levels, 0 <= smoothing < 1, 0 <= prior <= 1"
            )
        if not 0 <= self.distil <= 1:
            raise InputError(f"training: distil is {self.distil}, expected 0..1")
        if any(share < 0 for share in self.shares) or (self.shares and not sum(self.shares) > 0):
            raise InputError(f"training: shares are {self.shares}, expected none below 0 and a sum above 0")
