"""Files that want to be more than data: they name code, reach outside, or pretend to be huge."""

import io
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io
from corner_frames import FRAMES, config, record

from dsmap.errors import InputError
from dsmap.files import write_yaml
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.checkpoint import save_map
from dsmap.fusion.runs.read_run import load_run
from dsmap.limits import MAX_ARRAY_BYTES, MAX_MAT_BYTES, MAX_MODEL_ELEMENTS, MAX_PIECE_BYTES
from dsmap.sequences.arrays import read_array
from dsmap.tools.cli import run
from dsmap.tools.commands.evaluate import Args, segmenter_of
from dsmap.tools.mapping.segmenters import SegmenterSpec, make_segmenter
from dsmap.tools.support.recipes import load_recipe
from dsmap.tools.twins.corner import INTRINSICS


@pytest.fixture
def trap(tmp_path, monkeypatch):
    """A module in the current folder that notes when it is loaded."""
    (tmp_path / "trap_of_data.py").write_text(
        "import pathlib\npathlib.Path(__file__).with_suffix('.ran').touch()\n"
        "def factory():\n    return lambda frame: None\n"
        "def broken():\n    raise RuntimeError('boom')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    yield tmp_path / "trap_of_data.ran"
    sys.modules.pop("trap_of_data", None)


CODE = "trap_of_data:factory"


def test_no_file_names_code(trap, tmp_path, capsys):
    recording, out = record(tmp_path / "room"), tmp_path / "run"
    mapper = Mapper(config(), INTRINSICS)
    mapper.step(FRAMES[0])
    progress = {"done": 1, "skipped": [], "wall_s": 0.0}
    command = {"path": str(recording), "out": str(out), "segmenter": CODE}
    save_map(mapper, out / "checkpoint.safetensors", run={"command": command, **progress})
    write_yaml(out / "config.yaml", {"segmenter": {"kind": CODE}, "sequence": {"path": str(recording)}})
    write_yaml(tmp_path / "mine.yaml", {"segmenter": CODE})

    for argv in (
        [str(recording), "--out", str(out), "--resume"],
        [str(recording), "--out", str(tmp_path / "new"), "--config", str(tmp_path / "mine.yaml")],
    ):
        assert run("map", argv) == 2
        said = capsys.readouterr().err
        assert f"expected --segmenter {CODE} on the command line" in said and said.count("\n") == 1
    assert segmenter_of(load_run(out), Args(run=out)) is None
    assert "not run" in capsys.readouterr().out
    with pytest.raises(InputError, match="expected --segmenter"):
        make_segmenter(SegmenterSpec(CODE))
    assert not trap.exists() and "trap_of_data" not in sys.modules


def test_the_command_line_does(trap, tmp_path):
    asked = SimpleNamespace(path=tmp_path, settings={"segmenter": {"kind": CODE}})
    assert segmenter_of(asked, Args(run=tmp_path, segmenter=CODE)) is not None
    assert trap.exists() and sys.path[-1] == "" and sys.path[0] != "", "the current folder comes last"
    with pytest.raises(InputError, match=r"raised RuntimeError \(boom\)"):
        make_segmenter(SegmenterSpec("trap_of_data:broken"), code=True)


def test_hdf5_arrays_elsewhere_are_not_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    from dsmap.dsnet.datasets.nyuv2 import dataset_of

    (tmp_path / "secret").write_bytes(b"secret" * 100)
    with h5py.File(tmp_path / "other.mat", "w") as file:
        file["images"] = np.zeros((2, 3, 4, 5), np.uint8)
    path = tmp_path / "data.mat"
    with h5py.File(path, "w") as file:
        file.create_dataset("outside", (300,), np.uint8, external=[(str(tmp_path / "secret"), 0, 300)])
        file["linked"] = h5py.ExternalLink("other.mat", "images")
        file["soft"] = h5py.SoftLink("/outside")
        layout = h5py.VirtualLayout((2, 3, 4, 5), np.uint8)
        layout[...] = h5py.VirtualSource("other.mat", "images", shape=(2, 3, 4, 5))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("huge", (2, 3, 1 << 20, 1 << 10), np.uint8, chunks=(1, 1, 64, 64))
        file.create_dataset("group/plain", data=np.arange(6, dtype=np.uint8))
    with h5py.File(path, "r") as file:
        assert dataset_of(file, "group/plain", path)[3] == 3
        for name, words in [
            ("outside", "another file"), ("linked", "link to elsewhere"), ("soft", "link to elsewhere"),
            ("virtual", "another file"), ("none", "no none in it"), ("huge", f"at most {MAX_PIECE_BYTES:,}"),
            ("group/plain/x", "in it"), ("group", "another file"),
        ]:  # fmt: skip
            with pytest.raises(InputError, match=words):
                dataset_of(file, name, path)


def test_matlab_variables_are_bounded_before_they_are_unpacked(tmp_path):
    from dsmap.dsnet.datasets.nyuv2 import read_mat

    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"x": np.arange(5)}, do_compression=True)
    assert read_mat(path, "x")[4] == 4
    head = path.read_bytes()[:128]
    huge = zlib.compress(struct.pack("<II", 14, MAX_MAT_BYTES + 8) + bytes(1000))
    for element in (
        struct.pack("<II", 15, len(huge)) + huge,
        struct.pack("<II", 14, MAX_MAT_BYTES + 8) + bytes(100),
    ):
        path.write_bytes(head + element)
        with pytest.raises(InputError, match=f"a variable of {MAX_MAT_BYTES + 8:,} bytes, expected at most"):
            read_mat(path, "x")


def test_arrays_are_bounded_by_their_headers():
    def header(shape, dtype="<f4") -> bytes:
        stream = io.BytesIO()
        np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
        return stream.getvalue() + bytes(64)

    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("depth.npy", header((1 << 20, 1 << 20)))
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("depth.npy", bytes(MAX_ARRAY_BYTES // 4))
        for k in range(5):
            archive.writestr(f"more{k}.npy", bytes(MAX_ARRAY_BYTES // 4))
    for data in (header((1 << 20, 1 << 20)), header((1 << 62,)), packed.getvalue(), bomb.getvalue()):
        with pytest.raises(InputError, match=f"expected an image of at most {MAX_ARRAY_BYTES:,}"):
            read_array("a.npy", data)
    whole = io.BytesIO()
    np.savez_compressed(whole, depth=np.full((3, 4), 2.0, np.float32))
    assert (read_array("a.npz", whole.getvalue()) == 2).all()


def test_a_model_is_counted_before_it_is_built(tmp_path):
    from dsmap.sim_scenes.importers.mjcf_size import check_mjcf_size

    def model(body: str, more: str = "") -> Path:
        path = tmp_path / "model.xml"
        path.write_text(f"<mujoco>{more}<worldbody>{body}</worldbody></mujoco>")
        return path

    geom = '<geom type="box" size="1 1 1"/>'
    check_mjcf_size(model(f'<replicate count="100" offset="1 0 0">{geom}</replicate>'))
    nested = geom
    for _ in range(4):
        nested = f'<replicate count="100" offset="1 0 0">{nested}</replicate>'
    (tmp_path / "part.xml").write_text(f'<mujoco><replicate count="9999">{geom}</replicate></mujoco>')
    (tmp_path / "loop.xml").write_text('<mujoco><include file="loop.xml"/></mujoco>')
    texture = '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>'
    for body, more, words in [
        (nested, "", f"expected at most {MAX_MODEL_ELEMENTS:,}"),
        (f'<replicate count="1e300">{geom}</replicate>', "", f"at most {MAX_MODEL_ELEMENTS:,}"),
        (f'<replicate count="999">{geom * 300}</replicate>', "", "unfolds to"),
        ('<replicate count="99"><include file="part.xml"/></replicate>', "", "unfolds to"),
        ('<include file="loop.xml"/>', "", "includes more than"),
        ('<composite count="9999 9999 1"/>', "", "unfolds to"),
        (geom, texture, "'t' asks for 10,000,000,000 texels"),
        (geom, '<asset><hfield name="h" nrow="99999" ncol="99999"/></asset>', "'h' asks for"),
        (geom, '<size memory="900G"/>', "<size> asks for more than 1024 MiB"),
        (geom, '<size nuserdata="2000000000"/>', "<size> asks for"),
        ('<replicate count="many"/>', "", "expected numbers"),
        ("<broken", "", "not readable as MJCF"),
    ]:
        with pytest.raises(InputError, match=words):
            check_mjcf_size(model(body, more))


def test_a_cut_copies_nothing_from_outside(tmp_path, capsys):
    recording = record(tmp_path / "room")
    secret = tmp_path / "secret.png"
    secret.write_bytes(sorted((recording / "rgb").iterdir())[0].read_bytes())
    lines = (recording / "rgb.txt").read_text().splitlines()
    for k, name in enumerate([str(secret), "../secret.png", "rgb/link.png"]):
        (recording / "rgb" / "link.png").unlink(missing_ok=True)
        (recording / "rgb" / "link.png").symlink_to(secret)
        stamp = lines[4].split()[0]
        (recording / "rgb.txt").write_text("\n".join([*lines[:4], f"{stamp} {name}", *lines[5:]]) + "\n")
        out = tmp_path / f"cut{k}"
        assert run("cut", [str(recording), str(out)]) == 2
        assert "lies outside the recording" in capsys.readouterr().err and not out.exists()
        assert run("cut", [str(recording), str(out), "--outside"]) == 0
    (recording / "rgb.txt").write_text("\n".join(lines) + "\n")
    (recording / "mesh.ply").symlink_to(secret)
    assert run("cut", [str(recording), str(tmp_path / "last")]) == 2


@pytest.mark.parametrize("name", ["../../elsewhere", "/tmp/x", "a/b", "..", "", "x" * 99])
def test_a_stage_of_a_recipe_stays_in_its_folder(tmp_path, name):
    write_yaml(tmp_path / "r.yaml", {"stages": [{"name": name, "data": ["x"]}]})
    with pytest.raises(InputError, match="it becomes a folder"):
        load_recipe(str(tmp_path / "r.yaml"))
