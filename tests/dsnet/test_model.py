"""DS-Net against Table 1 of the paper, and its weights files and segmenter."""

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from dsmap.classes import CLASS_NAMES  # noqa: E402
from dsmap.dsnet.checkpoint import WeightsInfo, load_weights, save_tensors, save_weights  # noqa: E402
from dsmap.dsnet.config import DSNetConfig  # noqa: E402
from dsmap.dsnet.inference.predict import load_segmenter  # noqa: E402
from dsmap.dsnet.networks.dsnet import DSNet, fold_batch_norms, to_input  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.frame import Frame  # noqa: E402

SMALL = DSNetConfig(layers=2, growth=4, widths=(6, 8, 8, 10), stem_convs=1)


def parameters(model) -> int:
    return sum(p.numel() for p in model.parameters())


def random_image(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def warmed_up(config):
    """A network whose batch norms hold statistics that are not the identity."""
    torch.manual_seed(0)
    model = DSNet(config).train()
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = None  # the plain average of what was seen, at once
    with torch.no_grad():
        for seed in range(3):
            model(to_input(random_image(64, 96, seed)[None]))
    return model.eval()


@pytest.mark.parametrize(("stem_convs", "count"), [(1, 107_980), (3, 112_652)])
def test_parameter_count_of_the_paper_size(stem_convs, count):
    assert parameters(DSNet(DSNetConfig(layers=4, growth=16, stem_convs=stem_convs))) == count


def test_output_sizes_of_table_1():
    sizes = {}
    model = DSNet(DSNetConfig(stem_convs=1)).eval()
    for name, module in model.named_modules():
        if name:
            module.register_forward_hook(
                lambda _, __, out, name=name: sizes.update(
                    {name: tuple((out[0] if isinstance(out, tuple) else out).shape[1:])}
                )
            )
    with torch.inference_mode():
        model(torch.zeros(1, 3, 448, 448))
    assert sizes["stem"] == (16, 224, 224)
    for block, side in (("b1", 112), ("b2", 56), ("b3", 28), ("b4", 14)):
        assert sizes[f"{block}.pool"] == (16, side, side)
        assert sizes[f"{block}.dense"] == (80, side, side)
        assert sizes[block] == (16, side, side)
    for block, side, channels in (("d1", 28, 16), ("d2", 56, 16), ("d3", 112, 16), ("d4", 224, 14)):
        assert sizes[f"{block}.unpool"] == (16, side, side)
        assert sizes[f"{block}.deconv1"] == (16, side + 1, side + 1)
        assert sizes[f"{block}.deconv2"] == (channels, side, side)


def test_final_relu_is_a_choice():
    x = to_input(random_image(64, 64)[None])
    with torch.inference_mode():
        assert DSNet(SMALL).eval()(x).min() < 0
        assert DSNet(DSNetConfig(layers=2, growth=4, final_relu=True)).eval()(x).min() >= 0


@pytest.mark.parametrize(
    "wrong", [{"stem_convs": 2}, {"layers": 0}, {"widths": (16, 16, 16)}, {"dropout": 1.0}, {"growth": -1}]
)
def test_impossible_shapes_are_named(wrong):
    with pytest.raises(InputError, match="DS-Net"):
        DSNet(DSNetConfig(**wrong))


def test_folding_batch_norms_keeps_the_answer():
    model = warmed_up(SMALL)
    x = to_input(random_image(64, 96)[None])
    with torch.inference_mode():
        before = model(x)
        folded = fold_batch_norms(model)
        after = folded(x)
    assert sum(isinstance(m, torch.nn.BatchNorm2d) for m in folded.modules()) == 4 * (SMALL.layers + 1)
    assert before.std() > 0.05
    torch.testing.assert_close(before, after, rtol=1e-4, atol=1e-4)


def test_weights_round_trip_and_segment(tmp_path):
    model = warmed_up(SMALL)
    path = tmp_path / "net.safetensors"
    save_weights(path, model, WeightsInfo(SMALL, size=(96, 64), temperature=1.5, notes={"seed": 3}))
    loaded, info = load_weights(path)
    assert (info.size, info.temperature, info.config, info.notes) == ((96, 64), 1.5, SMALL, {"seed": 3})
    image = random_image(64, 96)
    with torch.inference_mode():
        expected = torch.softmax(model(to_input(image[None])) / 1.5, dim=1)[0].permute(1, 2, 0).numpy()
    frame = Frame(0, 0.0, image, np.ones((64, 96), np.float32))
    probabilities = load_segmenter(path)(frame)
    assert probabilities.shape == (32, 48, 14) and probabilities.dtype == np.float32
    np.testing.assert_allclose(probabilities.sum(axis=2), 1, atol=1e-5)
    np.testing.assert_allclose(probabilities, expected, atol=1e-4)
    other_size = load_segmenter(path)(Frame(0, 0.0, random_image(240, 320), np.ones((240, 320), np.float32)))
    assert other_size.shape == (32, 48, 14)


def test_foreign_and_damaged_weights_are_input_errors(tmp_path):
    good, bad = tmp_path / "good.safetensors", tmp_path / "bad.safetensors"
    save_weights(good, DSNet(SMALL), WeightsInfo(SMALL, size=(96, 64)))
    with pytest.raises(InputError, match="no such file"):
        load_segmenter(bad)
    bad.write_bytes(good.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"bad.safetensors.*damaged"):
        load_segmenter(bad)
    bad.write_bytes(b"pickle")
    with pytest.raises(InputError, match="damaged"):
        load_segmenter(bad)
    save_tensors(bad, {"x": torch.zeros(1)}, "someone.else", {})
    with pytest.raises(InputError, match=r"'someone.else'.*expected 'dsmap.dsnet/2'"):
        load_segmenter(bad)
    header = {"config": {}, "size": [96, 64], "temperature": 1.0, "class_names": CLASS_NAMES, "notes": {}}
    save_tensors(bad, {"x": torch.zeros(1)}, "dsmap.dsnet", header)
    with pytest.raises(InputError, match="unknown"):
        load_segmenter(bad)


def rewritten(path, **changes):
    """The same weights file with some header fields replaced."""
    import safetensors
    from safetensors.torch import load_file

    with safetensors.safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()["header"])
    save_tensors(path, load_file(path), "dsmap.dsnet", {**header, **changes})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"class_names": ["void", "cat"]}, "classes are"),
        ({"size": [100, 64]}, "multiples of 32"),
        ({"temperature": 0.0}, "temperature"),
        ({"temperature": "warm"}, "unknown"),
    ],
)
def test_wrong_headers_are_named(tmp_path, change, message):
    path = tmp_path / "net.safetensors"
    save_weights(path, DSNet(SMALL), WeightsInfo(SMALL, size=(96, 64)))
    rewritten(path, **change)
    with pytest.raises(InputError, match=message):
        load_weights(path)


def test_weights_of_another_shape_are_named(tmp_path):
    path = tmp_path / "net.safetensors"
    save_weights(path, DSNet(SMALL), WeightsInfo(DSNetConfig(layers=3, growth=4), size=(96, 64)))
    with pytest.raises(InputError, match="do not fit"):
        load_weights(path)
