"""Networks by name: their sizes, their common contract, and what can start from what."""

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights, save_weights  # noqa: E402
from dsmap.dsnet.config import (  # noqa: E402
    DSNETS,
    ClassifierConfig,
    DeconvNetConfig,
    DSNetConfig,
    DSNetPConfig,
    NetChoice,
    TrainConfig,
)
from dsmap.dsnet.inference.predict import load_segmenter  # noqa: E402
from dsmap.dsnet.networks.build import build_network  # noqa: E402
from dsmap.dsnet.networks.classifier import Classifier  # noqa: E402
from dsmap.dsnet.networks.deconvnet import DeconvNet  # noqa: E402
from dsmap.dsnet.networks.dsnet import fold_batch_norms, to_input  # noqa: E402
from dsmap.dsnet.training.state import new_state, start_from  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.frame import Frame, FrameGeometry  # noqa: E402

TINY = DSNetConfig(layers=1, growth=4, widths=(4, 4, 4, 4), stem_convs=1)
THIN = DeconvNetConfig(width=1 / 32)
PLUS = DSNetPConfig("lite0", widths=(16, 16, 8, 8))


def parameters(model) -> int:
    return sum(p.numel() for p in model.parameters())


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("dsnet", 112_652),
        ("dsnet-m", 639_156),
        ("dsnet-l", 2_396_828),
        ("dsnet-xl", 3_357_308),
        ("deconvnet", 251_788_494),
    ],
)
def test_parameter_counts(name, count):
    with torch.device("meta"):
        assert parameters(build_network(NetChoice(name).config())) == count


def test_shipped_nets_fit_into_30_megabytes():
    with torch.device("meta"):
        total = sum(parameters(build_network(config)) for config in (DSNETS["dsnet"], DSNetPConfig("lite2")))
    assert 4 * total < 30e6


def test_deconvnet_is_the_one_of_noh_et_al():
    """Fully connected layers and convolutions as in the paper's Table 1, without convolution biases."""
    with torch.device("meta"):
        model = DeconvNet(DeconvNetConfig())
    assert tuple(model.fc6[0].weight.shape) == (4096, 512, 7, 7)
    assert tuple(model.fc6_deconv[0].weight.shape) == (4096, 512, 7, 7)
    assert [len(stage) for stage in model.encoder.stages] == [2, 2, 3, 3, 3]
    assert [len(stage) for stage in model.stages] == [3, 3, 3, 2, 2]
    vgg = 64 * 27 + 9 * (64 * 64 + 64 * 128 + 128**2 + 128 * 256 + 2 * 256**2 + 256 * 512 + 5 * 512**2)
    convs = sum(m.weight.numel() for m in model.encoder.modules() if isinstance(m, torch.nn.Conv2d))
    assert convs == vgg


@pytest.mark.parametrize("config", [TINY, dataclasses.replace(TINY, channels=7), THIN, PLUS])
def test_logits_at_half_the_size_and_gradients_everywhere(config):
    torch.manual_seed(0)
    model = build_network(config).train()
    side = 224 if isinstance(config, DeconvNetConfig) else 64
    out = model(torch.randn(2, config.channels, side, side))
    assert tuple(out.shape) == (2, 14, side // 2, side // 2) and model.config is config
    out.square().mean().backward()
    assert all(p.grad is not None and torch.isfinite(p.grad).all() for p in model.parameters())


def test_deconvnet_needs_224_pixels_and_folds():
    torch.manual_seed(0)
    model = build_network(THIN).eval()
    with pytest.raises(InputError, match="at least 224x224"):
        model(torch.zeros(1, 3, 192, 224))
    x = torch.randn(1, 3, 224, 224)
    with torch.inference_mode():
        before = model(x)
        torch.testing.assert_close(before, fold_batch_norms(model)(x), rtol=1e-3, atol=1e-4)
    assert not any(isinstance(m, torch.nn.BatchNorm2d) for m in model.modules())


@pytest.mark.parametrize("encoder", [DSNetConfig(classes=10), DeconvNetConfig(1 / 32, classes=10)])
def test_classifiers_of_32_pixel_images(encoder):
    model = Classifier(ClassifierConfig(encoder))
    assert tuple(model(torch.randn(3, 3, 32, 32)).shape) == (3, 10)


@pytest.mark.parametrize("layers", [3, 4, 5])
@pytest.mark.parametrize("growth", [8, 16, 32])
def test_classifier_sizes_by_the_formula(layers, growth):
    """3 stem convolutions, four blocks of L 3x3 convolutions on 16 + i K channels, 1x1 back to 16, BNs, 10 outputs."""
    stem = 27 * 16 + 2 * 9 * 16 * 16 + 3 * 2 * 16
    inner = [16 + i * growth for i in range(layers + 1)]
    block = sum(9 * c * growth + 2 * c for c in inner[:-1]) + 2 * inner[-1] + 16 * inner[-1]
    config = DSNetConfig(layers=layers, growth=growth, classes=10)
    assert parameters(Classifier(ClassifierConfig(config))) == stem + 4 * block + 16 * 10 + 10


def test_stem_stride_of_a_classifier():
    encoder = dataclasses.replace(TINY, classes=10)
    one, two = (Classifier(ClassifierConfig(encoder, stride)) for stride in (1, 2))
    x = torch.zeros(1, 3, 64, 64)
    assert one.features(x)[0].shape[2] == 4 and two.features(x)[0].shape[2] == 2


def test_choices_override_and_refuse():
    assert NetChoice("dsnet-l", growth=8, dropout=0.0).config(22) == dataclasses.replace(
        DSNETS["dsnet-l"], growth=8, dropout=0.0, classes=22
    )
    assert NetChoice(geometry=True).config().channels == 7 and NetChoice("dsnet-p").config().channels == 7
    assert NetChoice("dsnet-p", geometry=False, encoder="lite0").config() == DSNetPConfig("lite0", channels=3)
    with pytest.raises(InputError, match="deconvnet has no layers"):
        NetChoice("deconvnet", layers=3).config()
    with pytest.raises(InputError, match="dsnet has no encoder"):
        NetChoice(encoder="lite0").config()
    with pytest.raises(InputError, match="dsnet-p has no layers"):
        NetChoice("dsnet-p", layers=3).config()
    with pytest.raises(InputError, match="width"):
        NetChoice("deconvnet", width=2.0).config()


@pytest.mark.parametrize("config", [TINY, THIN, dataclasses.replace(TINY, channels=7), PLUS])
def test_weights_of_every_kind_round_trip(tmp_path, config):
    model = build_network(config)
    save_weights(tmp_path / "net.safetensors", model, WeightsInfo(config, size=(224, 224)))
    loaded, info = load_weights(tmp_path / "net.safetensors")
    assert info.config == config
    for name, tensor in loaded.state_dict().items():
        assert torch.equal(tensor, model.state_dict()[name]), name


def test_geometry_reaches_the_network_and_colour_alone_serves(tmp_path):
    config = dataclasses.replace(TINY, channels=7)
    torch.manual_seed(0)
    model = build_network(config).train()
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = None  # the plain average of what was seen, at once
    with torch.no_grad():
        model(torch.randn(4, 7, 64, 64))
    save_weights(tmp_path / "net.safetensors", model, WeightsInfo(config, size=(64, 64)))
    segmenter = load_segmenter(tmp_path / "net.safetensors")
    assert segmenter.wants_geometry
    frame = Frame(0, 0.0, np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8), np.ones((64, 64)))
    near, far = (np.full((64, 64, 4), d, np.float32) for d in (1.0, -1.0))
    answers = [segmenter(frame, FrameGeometry(seen, np.zeros(3), 0.0)) for seen in (near, far)]
    assert np.abs(answers[0] - answers[1]).max() > 0.01
    np.testing.assert_array_equal(segmenter(frame), segmenter.predict(frame.rgb, 0 * near))


def test_geometry_follows_the_colours_as_it_is():
    geometry = np.random.default_rng(0).normal(size=(1, 2, 3, 4)).astype(np.float16)
    x = to_input(np.full((1, 2, 3, 3), 255, np.uint8), geometry)
    assert tuple(x.shape) == (1, 7, 2, 3) and x[0, :3].unique().tolist() == [127.5 / 64]
    np.testing.assert_array_equal(x[0, 3:].permute(1, 2, 0).numpy(), geometry[0].astype(np.float32))


def test_starting_from_other_classes_and_without_depth(tmp_path):
    voc = dataclasses.replace(TINY, classes=22)
    torch.manual_seed(0)
    given, path = build_network(voc), tmp_path / "voc.safetensors"
    save_weights(path, given, WeightsInfo(voc, size=(64, 64), class_names=("void", *map(str, range(21)))))
    with pytest.raises(InputError, match="classes are"):
        load_segmenter(path)
    rgbd = build_network(dataclasses.replace(TINY, channels=7, dropout=0.5))
    fresh = rgbd.d4.deconv2[0].weight.clone()
    copied = start_from(rgbd, path)
    assert torch.equal(rgbd.stem[0][0].weight[:, :3], given.stem[0][0].weight)
    assert not rgbd.stem[0][0].weight[:, 3:].any()
    assert torch.equal(rgbd.b3.conv.weight, given.b3.conv.weight) and "b3.conv.weight" in copied
    assert torch.equal(rgbd.d4.deconv2[0].weight, fresh) and "d4.deconv2.0.weight" not in copied
    with pytest.raises(InputError, match="network is"):
        start_from(build_network(dataclasses.replace(TINY, growth=8)), path)


def test_old_names_say_what_took_their_place():
    for old, new in (("dsnet-l", "dsnet-p"), ("dsnet-photos", "dsnet"), ("dsnet-l-photos", "dsnet-p")):
        with pytest.raises(InputError, match=f"weights {old}: no longer ship, expected {new},"):
            load_weights(old)


def test_learning_rate_of_given_weights(tmp_path):
    path = tmp_path / "net.safetensors"
    config = dataclasses.replace(TINY, classes=22)
    save_weights(
        path, build_network(config), WeightsInfo(config, (64, 64), class_names=("void", *map(str, range(21))))
    )
    state = new_state(TINY, TrainConfig(init_lr=0.125), path, "cpu")
    scale = {id(p): group["scale"] for group in state.optimiser.param_groups for p in group["params"]}
    assert scale[id(state.model.stem[0][0].weight)] == 0.125
    assert scale[id(state.model.d4.deconv2[0].weight)] == 1.0
    decay = {id(p): g["weight_decay"] for g in state.optimiser.param_groups for p in g["params"]}
    assert decay[id(state.model.stem[0][1].weight)] == 0 < decay[id(state.model.stem[0][0].weight)]
