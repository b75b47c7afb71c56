"""The engines that run a network: torch, ONNX Runtime, an exported file on its own, Warp's arrays, and their race."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")
ort = pytest.importorskip("onnxruntime")

import torch.nn.functional as F  # noqa: E402

from dsmap.classes import CLASS_NAMES  # noqa: E402
from dsmap.dsnet.checkpoint import WeightsInfo, save_weights  # noqa: E402
from dsmap.dsnet.config import DSNETS, DeconvNetConfig, DSNetConfig, DSNetPConfig  # noqa: E402
from dsmap.dsnet.inference import compare_engines, engines  # noqa: E402
from dsmap.dsnet.inference.onnx_export import (  # noqa: E402
    _first_maxima,
    _first_maxima_blocked,
    _max_pool,
    build_onnx,
)
from dsmap.dsnet.inference.onnx_graph import Graph  # noqa: E402
from dsmap.dsnet.inference.predict import DSNetSegmenter, load_segmenter  # noqa: E402
from dsmap.dsnet.networks.build import build_network  # noqa: E402
from dsmap.dsnet.networks.dsnet import DSNet, to_input  # noqa: E402
from dsmap.dsnet.networks.dsnet_p import DSNetP  # noqa: E402
from dsmap.dsnet.networks.efficientnet_lite import FrozenConv  # noqa: E402
from dsmap.errors import InputError  # noqa: E402
from dsmap.tools import cli  # noqa: E402
from dsmap.tools.commands import bench_net  # noqa: E402

SMALL = DSNetConfig(layers=2, growth=4, widths=(6, 8, 8, 10), stem_convs=1)
PLUS = DSNetPConfig("lite0", widths=(24, 16, 16, 16))
WIDTH, HEIGHT = 96, 64


def picture(seed=0, width=WIDTH, height=HEIGHT):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def geometry(seed=0):
    channels = np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH, 4)).astype(np.float32)
    channels[..., 3] = channels[..., 3] > -0.5
    return channels * channels[..., 3:]


def network(config=SMALL, seed=0):
    """A network with batch norms that have seen something, and answers that are far from uniform."""
    torch.manual_seed(seed)
    model = build_network(config).train()
    for module in model.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.momentum = None
            torch.nn.init.uniform_(module.bias, -0.5, 0.5)
            torch.nn.init.uniform_(module.weight, -0.3, 1.2)  # some are negative
    more = (np.stack([geometry(1), geometry(2)]),) if config.channels == 7 else ()
    with torch.no_grad():
        if isinstance(model, DSNetP):
            for conv in model.inject if config.geometry else ():
                torch.nn.init.normal_(conv.weight, std=0.1)
            for conv in model.encoder.modules():
                if isinstance(conv, FrozenConv):
                    conv.mean.uniform_(-0.2, 0.2)
                    conv.var.uniform_(0.2, 0.6)
            model.score.weight.mul_(20)
        else:
            model.d4.deconv2[1].weight.fill_(3.0)
        model(to_input(np.stack([picture(1), picture(2)]), *more))
    return model.eval()


def saved(path, config=SMALL, temperature=1.7):
    save_weights(path, network(config), WeightsInfo(config, (WIDTH, HEIGHT), temperature))
    return path


@pytest.mark.parametrize(
    "config",
    [
        SMALL,
        replace(SMALL, channels=7),
        replace(SMALL, final_relu=True, stem_convs=3),
        replace(DSNETS["dsnet-m"], dropout=0.0),
        PLUS,
        replace(PLUS, channels=3),
        replace(PLUS, encoder="lite2"),
    ],
    ids=["small", "rgbd", "final-relu", "dsnet-m", "dsnet-p", "dsnet-p-rgb", "dsnet-p-lite2"],
)
def test_onnx_runtime_answers_as_torch_does(tmp_path, config):
    path = saved(tmp_path / "net.safetensors", config)
    ours, theirs = load_segmenter(path, engine="torch"), load_segmenter(path, engine="onnx")
    assert (ours.engine.name, theirs.engine.name) == ("torch", "onnx")
    for seed in (3, 4):
        a, b = ours.predict(picture(seed), geometry(seed)), theirs.predict(picture(seed), geometry(seed))
        assert a.std() > 0.05, "not uniform"
        for answer in (a, b):
            assert answer.shape == (HEIGHT // 2, WIDTH // 2, 14) and answer.dtype == np.float32
            assert answer.flags.c_contiguous and answer.flags.writeable
            np.testing.assert_allclose(answer.sum(axis=2), 1, atol=1e-5)
        assert np.abs(a - b).max() < 1e-2
    shown, alone = (theirs.predict(picture(3), seen) for seen in (geometry(3), None))
    assert (np.abs(shown - alone).max() > 0.01) == (config.channels == 7), "geometry counts where it is read"
    assert np.abs(alone - ours.predict(picture(3))).max() < 1e-2, "colour alone"
    np.testing.assert_array_equal(alone, theirs.predict(picture(3), 0 * geometry(3)))
    first = theirs.predict(picture(3), geometry(3))
    kept = first.copy()
    theirs.predict(picture(4), geometry(4))
    np.testing.assert_array_equal(first, kept, "the next call must not write into an answer that was given")


@pytest.mark.parametrize("engine", ["torch", "onnx"])
@pytest.mark.parametrize("temperature", [0.6, 2.5])
def test_probabilities_are_calibrated(tmp_path, engine, temperature):
    segmenter = load_segmenter(saved(tmp_path / "net.safetensors", temperature=temperature), engine=engine)
    logits = segmenter.logits(picture(3))
    expected = torch.softmax(torch.from_numpy(logits) / temperature, dim=2).numpy()
    np.testing.assert_allclose(segmenter.predict(picture(3)), expected, atol=1e-4)


@pytest.mark.parametrize("mark", [_first_maxima, _first_maxima_blocked])
@pytest.mark.parametrize("unit", [1.0, 1e-20])
def test_unpooling_writes_where_the_first_maximum_was(mark, unit):
    x = (
        unit * torch.randint(0, 3, (2, 3, 8, 12), generator=torch.Generator().manual_seed(0)).float()
    )  # full of ties
    g = Graph()
    g.name(mark(g, "x", _max_pool(g, "x"), 8, 12, 3), "mask")
    value = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        g.nodes, "unpool", [value("x", 1, list(x.shape))], [value("mask", 1, list(x.shape))], g.constants
    )
    proto = onnx.helper.make_model(
        graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9
    ).SerializeToString()
    mask = ort.InferenceSession(proto).run(None, {"x": x.numpy()})[0]
    pooled, indices = F.max_pool2d(x, 2, return_indices=True)
    expected = F.max_unpool2d(torch.ones_like(pooled), indices, 2)
    np.testing.assert_array_equal(mask, expected.numpy())


@pytest.mark.parametrize("unpool", ["mask", "blocked", "index"])
def test_all_forms_of_unpooling_and_batches(unpool):
    model, info = network(), WeightsInfo(SMALL, (WIDTH, HEIGHT), 1.3)
    images = np.stack([picture(3), picture(4)])
    session = ort.InferenceSession(build_onnx(model, info, batch=0, unpool=unpool).SerializeToString())
    answer = session.run(None, {"image": images})[0]
    with torch.inference_mode():
        expected = torch.softmax(model(to_input(images)) / 1.3, dim=1).permute(0, 2, 3, 1).numpy()
    np.testing.assert_allclose(answer, expected, atol=1e-4)


FOREIGN = """
import sys, json, numpy, onnxruntime
session = onnxruntime.InferenceSession(sys.argv[1])
inputs = dict(numpy.load(sys.argv[2]))
answer = session.run(None, inputs)[0]
numpy.save(sys.argv[3], answer)
names = json.loads(session.get_modelmeta().custom_metadata_map["class_names"])
print(json.dumps([names, [i.name for i in session.get_inputs()], "torch" in sys.modules, "dsmap" in sys.modules]))
"""


@pytest.mark.parametrize("channels", [3, 7])
def test_an_exported_file_needs_onnx_runtime_only(tmp_path, channels, capsys):
    path = saved(tmp_path / "net.safetensors", replace(SMALL, channels=channels))
    exported = tmp_path / "net.onnx"
    assert cli.run("export-onnx", [str(path), str(exported)]) == 0
    said = capsys.readouterr().out
    assert f"(1, {HEIGHT}, {WIDTH}, 3)" in said
    assert (f"geometry       float32 (1, {HEIGHT}, {WIDTH}, 4)" in said) == (channels == 7)
    inputs = {"image": picture(3)[None]} | ({"geometry": geometry(3)[None]} if channels == 7 else {})
    np.savez(tmp_path / "inputs.npz", **inputs)
    command = [sys.executable, "-c", FOREIGN, exported, tmp_path / "inputs.npz", tmp_path / "answer.npy"]
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=True, cwd=tmp_path, timeout=120
    )
    assert json.loads(done.stdout.splitlines()[-1]) == [list(CLASS_NAMES), list(inputs), False, False]
    expected = load_segmenter(path, engine="torch").predict(picture(3), geometry(3))
    assert np.abs(np.load(tmp_path / "answer.npy")[0] - expected).max() < 1e-2


def test_export_at_another_size_and_of_the_large_net(tmp_path):
    path = tmp_path / "net.safetensors"
    save_weights(path, DSNet(DSNETS["dsnet-l"]), WeightsInfo(DSNETS["dsnet-l"], (448, 448)))
    assert cli.run("export-onnx", [str(path), str(tmp_path / "l.onnx"), "--size", "64", "32"]) == 0
    session = ort.InferenceSession(tmp_path / "l.onnx")
    assert session.run(None, {"image": picture(0, 64, 32)[None]})[0].shape == (1, 16, 32, 14)


def test_what_cannot_be_exported_is_named(tmp_path, capsys):
    path = tmp_path / "other.safetensors"
    config = DeconvNetConfig(width=1 / 32)
    save_weights(path, build_network(config), WeightsInfo(config, (WIDTH, HEIGHT)))
    assert cli.run("export-onnx", [str(path), str(tmp_path / "x.onnx")]) == 2
    assert "expected a DS-Net" in capsys.readouterr().err
    path = saved(tmp_path / "net.safetensors")
    assert cli.run("export-onnx", [str(path), str(tmp_path / "x.onnx"), "--size", "100", "64"]) == 2
    assert "multiples of 32" in capsys.readouterr().err
    assert not (tmp_path / "x.onnx").exists()


def test_which_engine_auto_is(monkeypatch):
    model, cpu = network(), torch.device("cpu")
    assert engines.choose_engine("auto", model, cpu) == "onnx"
    assert engines.choose_engine("auto", model, torch.device("cuda")) == "torch"
    assert engines.choose_engine("auto", build_network(DeconvNetConfig(width=1 / 32)), cpu) == "torch"
    with pytest.raises(InputError, match="expected one of: auto, torch, onnx"):
        engines.choose_engine("fast", model, cpu)
    with pytest.raises(InputError, match="on cuda"):
        engines.choose_engine("onnx", model, torch.device("cuda"))
    monkeypatch.setattr(engines, "_NEEDED", ("onnx", "a_package_that_is_not_there"))
    assert engines.choose_engine("auto", model, cpu) == "torch"
    with pytest.raises(InputError, match="pip install"):
        engines.choose_engine("onnx", model, cpu)


@pytest.mark.parametrize("wrong", [np.zeros((64, 96, 3), np.float32), np.zeros((64, 96), np.uint8)])
def test_images_of_another_kind_are_refused(tmp_path, wrong):
    with pytest.raises(InputError, match="expected uint8"):
        load_segmenter(saved(tmp_path / "net.safetensors")).predict(wrong)


@pytest.mark.parametrize("channels", [3, 7])
def test_warp_arrays_go_in_and_out_without_copies(monkeypatch, channels):
    wp = pytest.importorskip("warp")
    from dsmap.dsnet.inference.warp_arrays import predict_warp

    config = replace(SMALL, channels=channels)
    segmenter = DSNetSegmenter(network(config), WeightsInfo(config, (WIDTH, HEIGHT), 1.3))
    seen = []
    inner = segmenter.torch_engine.softmax
    monkeypatch.setattr(
        segmenter.torch_engine, "softmax", lambda *x: seen.append((x, inner(*x))) or seen[-1][1]
    )
    rgb, more = wp.array(picture(3), dtype=wp.uint8), wp.array(geometry(3), dtype=wp.float32)
    answer = predict_warp(segmenter, rgb, more if channels == 7 else None)
    (image, given), out = seen[0]
    assert image.data_ptr() == rgb.ptr and out.data_ptr() == answer.ptr
    assert given is None or given.data_ptr() == more.ptr
    assert answer.dtype == wp.float32
    np.testing.assert_array_equal(answer.numpy(), segmenter.predict(picture(3), geometry(3)))
    alone, expected = predict_warp(segmenter, rgb).numpy(), segmenter.predict(picture(3))
    np.testing.assert_array_equal(alone, expected)
    large = [np.repeat(np.repeat(image, 2, axis=0), 2, axis=1) for image in (picture(3), geometry(3))]
    arrays = [wp.array(image, dtype=t) for image, t in zip(large, (wp.uint8, wp.float32), strict=True)]
    np.testing.assert_allclose(predict_warp(segmenter, *arrays).numpy(), answer.numpy(), atol=1e-5)


@pytest.mark.parametrize("size", [(WIDTH * 3, HEIGHT * 2), (133, 97), (50, 40)])
def test_torch_resizes_as_opencv_does(size):
    from dsmap.dsnet.inference.warp_arrays import _resize
    from dsmap.sequences.images import resize_colour

    image = picture(3, *size)
    ours = _resize(torch.from_numpy(image), HEIGHT, WIDTH).numpy().astype(int)
    assert np.abs(ours - resize_colour(image, WIDTH, HEIGHT)).max() <= 1  # rounding


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_a_captured_graph_answers_as_the_network_does():
    model, info = network(), WeightsInfo(SMALL, (WIDTH, HEIGHT), 1.3)
    expected = DSNetSegmenter(network(), info).predict(picture(3))
    segmenter = DSNetSegmenter(model, info, "cuda")
    for _ in range(2):
        assert np.abs(segmenter.predict(picture(3)) - expected).max() < 1e-2


@pytest.mark.slow
def test_the_race_is_run_in_processes_of_its_own():
    names = [
        compare_engines.REFERENCE,
        "torch, BN folded, memory kept",
        "ONNX Runtime, blocked masks",
        "no such contender",
    ]
    info = WeightsInfo(SMALL, (WIDTH, HEIGHT), 1.3)
    images = [(picture(3)[None],), (picture(4)[None],)]
    results = compare_engines.race(network(), info, images, rounds=2, repeats=1, names=names)
    assert results[0].difference == 0 and 0 <= results[0].chance < 0.2
    for result in results[:3]:
        assert result.equal and len(result.milliseconds) == 2
    assert "no such contender" in results[3].error


@pytest.mark.slow
def test_dsnet_p_races_with_dsnet_beside_it():
    info = WeightsInfo(PLUS, (WIDTH, HEIGHT), 1.3)
    samples = [(picture(3)[None], geometry(3)[None])]
    names = [compare_engines.REFERENCE, "ONNX Runtime, blocked masks"]
    rival = (network(), WeightsInfo(SMALL, (WIDTH, HEIGHT)))
    results = compare_engines.race(
        network(PLUS), info, samples, rounds=2, repeats=1, names=names, rival=rival
    )
    assert [r.error for r in results] == ["", "", ""] and results[1].equal and not results[2].equal
    assert "times as long as dsnet" in bench_net.net_table(results)


def test_whoever_is_wrong_or_missing_cannot_win():
    text = bench_net.net_table(
        [
            compare_engines.Result("plain", milliseconds=[30.0, 30.0]),
            compare_engines.Result(
                "right", milliseconds=[20.0, 10.0], difference=0.2, decided=1e-5, beyond=1e-4
            ),
            compare_engines.Result("wrong", milliseconds=[1.0, 1.0], difference=0.5, decided=0.5, beyond=0.5),
            compare_engines.Result("missing", error="No module named 'openvino'"),
        ]
    )
    assert "missing  not run: No module named" in text
    assert "too far off" in next(line for line in text.splitlines() if line.startswith("wrong"))
    assert "fastest within 0.01: right, 15.0 ms, 2.25 times as fast" in text


def test_bench_net_refuses_bad_input(tmp_path, capsys):
    for argv, words in (
        (["--size", "100", "64"], "multiples of 32"),
        (["--rounds", "0"], "expected 1 to"),
        (["--weights", str(tmp_path / "none")], "no such file"),
    ):
        assert cli.run("bench-net", argv) == 2
        assert words in capsys.readouterr().err
