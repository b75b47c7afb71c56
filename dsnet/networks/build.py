"""From a configuration to its network."""

from torch import nn

from dsmap.dsnet.config import DSNetConfig, DSNetPConfig, NetConfig
from dsmap.dsnet.networks.deconvnet import DeconvNet
from dsmap.dsnet.networks.dsnet import DSNet
from dsmap.dsnet.networks.dsnet_p import DSNetP


def build_network(config: NetConfig) -> nn.Module:
    """A network with fresh weights and its configuration as `.config`.

    All take float32 (N, channels, H, W) of `to_input`, H and W multiples of 32, and give logits
    (N, classes, H / 2, W / 2).
    """
    if isinstance(config, DSNetConfig):
        return DSNet(config)
    if isinstance(config, DSNetPConfig):
        return DSNetP(config)
    return DeconvNet(config)
