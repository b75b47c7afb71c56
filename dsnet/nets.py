"""From a configuration to its network."""

import torch.nn.functional as F
from torch import Tensor, nn

from dsmap.dsnet.config import DeconvNetConfig, DSNetConfig, DSNetPConfig, LibraryNetConfig, NetConfig
from dsmap.dsnet.deconvnet import DeconvNet
from dsmap.dsnet.dsnet_p import DSNetP
from dsmap.dsnet.model import DSNet
from dsmap.errors import InputError

_PACKAGES = {"pspnet": "segmentation_models_pytorch", "deeplabv3": "torchvision"}


def build(config: NetConfig) -> nn.Module:
    """A network with fresh weights and its configuration as `.config`.

    All take float32 (N, channels, H, W) of `to_input`, H and W multiples of 32, and give logits
    (N, classes, H / 2, W / 2).

    Raises:
        InputError: it needs a library that is not installed.
    """
    if isinstance(config, DSNetConfig):
        return DSNet(config)
    if isinstance(config, DSNetPConfig):
        return DSNetP(config)
    if isinstance(config, DeconvNetConfig):
        return DeconvNet(config)
    return LibraryNet(config)


class LibraryNet(nn.Module):
    """A network of another library behind the contract of `build`: its answer resized bilinearly."""

    def __init__(self, config: LibraryNetConfig):
        super().__init__()
        self.config = config
        try:
            self.net = _pspnet(config.classes) if config.name == "pspnet" else _deeplabv3(config.classes)
        except (ImportError, RuntimeError) as error:  # torchvision of another torch raises RuntimeError
            package = _PACKAGES[config.name]
            raise InputError(
                f"network {config.name} needs {package}, which cannot be loaded ({error}); expected "
                "pip install 'dsmap[baselines]' with the torchvision of the installed torch"
            ) from error

    def forward(self, x: Tensor) -> Tensor:
        size = (x.shape[2] // 2, x.shape[3] // 2)
        answer = self.net(x)
        logits = answer["out"] if isinstance(answer, dict) else answer
        return F.interpolate(logits, size=size, mode="bilinear", align_corners=False)


def _pspnet(classes: int) -> nn.Module:
    import segmentation_models_pytorch as smp

    return smp.PSPNet("resnet18", encoder_weights=None, classes=classes)


def _deeplabv3(classes: int) -> nn.Module:
    from torchvision.models.segmentation import deeplabv3_mobilenet_v3_large

    return deeplabv3_mobilenet_v3_large(weights=None, weights_backbone=None, num_classes=classes)
