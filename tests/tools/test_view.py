"""`dsmap view`: what it reads, what it selects, its pictures, and the page in a headless browser."""

import functools
import http.server
import json
import shutil
import socket
import threading
import urllib.error
import urllib.request

import cv2
import numpy as np
import pytest
from browser import browser, free_port, wait
from synthetic_map import CEILING, FLOOR, TABLE, WALL, camera_path, room_arrays

from dsmap.classes import PALETTE
from dsmap.errors import InputError
from dsmap.fusion.exports.ply import write_ply
from dsmap.fusion.exports.trajectory import write_trajectory
from dsmap.tools.commands.view import Args, main, read_run


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    write_ply(folder / "map.ply", room_arrays())
    write_trajectory(folder / "trajectory.txt", camera_path())
    return folder


def test_png_renders_the_views(run_dir, tmp_path, capsys):
    assert main(Args(run=run_dir, png=tmp_path)) == 0
    names = ["map_colour.png", "map_label.png", "map_segment.png", "map_confidence.png", "map_time.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert all(name in capsys.readouterr().out or name for name in names)
    image = cv2.imread(str(tmp_path / "map_time.png"))
    assert image.shape == (960, 1280, 3)
    assert image.std() > 10


def test_png_draws_boxes_with_names(run_dir, tmp_path):
    shutil.copytree(run_dir, tmp_path / "run")
    file = tmp_path / "run" / "objects.json"
    box = {"T_world_box": np.eye(4).tolist(), "extent": [1.0, 1.0, 1.0]}
    file.write_text(json.dumps({"objects": [{"name": "table 1", "class": "table", "box": box}]}))
    assert main(Args(run=tmp_path / "run", png=tmp_path / "with")) == 0
    assert main(Args(run=tmp_path / "run", png=tmp_path / "without", boxes=False)) == 0
    image = cv2.imread(str(tmp_path / "with" / "map_objects.png"))[..., ::-1]
    near = np.abs(image.astype(int) - PALETTE[TABLE]).max(axis=-1) < 12
    assert near.sum() > 100, "lines in the colour of the class"
    assert not (tmp_path / "without" / "map_objects.png").exists()
    file.write_text('{"objects": [{"name": "table 1", "class": "lamp"}]}')
    with pytest.raises(InputError, match=r"objects\.json: damaged"):
        main(Args(run=tmp_path / "run", png=tmp_path / "with"))


def test_not_a_run_is_a_clear_error(run_dir, tmp_path):
    with pytest.raises(InputError, match=r"has no map\.ply; expected a RUN folder"):
        main(Args(run=tmp_path / "missing"))
    shutil.copy(run_dir / "map.ply", tmp_path)
    with pytest.raises(InputError, match=r"has no trajectory\.txt"):
        main(Args(run=tmp_path))
    (tmp_path / "trajectory.txt").write_text("1 2 3 nonsense\n")
    with pytest.raises(InputError, match=r"trajectory\.txt"):
        main(Args(run=tmp_path))
    (tmp_path / "map.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(InputError, match=r"map\.ply"):
        main(Args(run=tmp_path))


def test_empty_map_and_bad_options(run_dir, tmp_path):
    write_ply(tmp_path / "map.ply", {name: values[:0] for name, values in room_arrays(0.5).items()})
    write_trajectory(tmp_path / "trajectory.txt", [])
    with pytest.raises(InputError, match="no surfels"):
        main(Args(run=tmp_path))
    with pytest.raises(InputError, match="--port is 0"):
        main(Args(run=run_dir, port=0))
    with pytest.raises(InputError, match="--max-points is 0"):
        main(Args(run=run_dir, max_points=0))


def test_cloud_selects_and_thins_out(run_dir):
    pytest.importorskip("viser")
    from dsmap.tools.support.viewer import MODES, Cloud

    arrays, poses, _ = read_run(run_dir)
    assert poses.shape == (30, 4, 4)
    cloud = Cloud(arrays, 1000)
    assert len(cloud) == 1000
    assert cloud.thinning == pytest.approx(len(arrays["weight"]) / 1000)
    share = (arrays["label"] == WALL).mean()
    assert (cloud.arrays["label"] == WALL).mean() == pytest.approx(share, abs=0.06)
    for mode in MODES:
        colours = cloud.colours(mode)
        assert colours.shape == (1000, 3)
        assert colours.dtype == np.uint8
    assert np.array_equal(cloud.colours("label"), PALETTE[cloud.arrays["label"]])
    keep = cloud.select({FLOOR, WALL}, 20, None)
    assert set(cloud.arrays["label"][keep]) == {FLOOR, WALL}
    assert cloud.arrays["weight"][keep].min() >= 20
    above = cloud.select(set(range(14)), 0, np.array([2.0, 1.5, 9.0]))
    assert set(cloud.arrays["label"][above]) == {FLOOR, TABLE, WALL}, "the ceiling faces away"
    assert not cloud.select(set(), 0, None).any()


@pytest.mark.slow
def test_page_in_a_headless_browser(run_dir, tmp_path):
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    pytest.importorskip("viser")
    from dsmap.tools.support.viewer import Cloud, MapViewer

    arrays, poses, _ = read_run(run_dir)
    viewer = MapViewer(Cloud(arrays, 100_000), poses, 0, "127.0.0.1", free_port(), "test")
    try:
        with browser(chromium, tmp_path, viewer.address) as page:
            text = wait(lambda: t if "Camera path" in (t := page.text()) else None)
            for words in (
                "Point size",
                "Min. confidence",
                "Cut away walls",
                "floor",
                "table",
                "wall",
                "Camera path",
            ):
                assert words in text, f"{words!r} is not on the page"
            viewer.mode.value = "label"
            viewer.update()
            wait(lambda: page.share(FLOOR) > 0.02 or None)
            assert page.share(WALL) > 0.02
            assert page.share(CEILING) < 0.02, "it is cut away"
            page.click("floor")
            wait(lambda: page.share(FLOOR) < 0.02 or None)
            assert not viewer.boxes[FLOOR].value
            assert page.share(WALL) > 0.02, "only the floor was switched off"
            page.click("Cut away walls")
            wait(lambda: page.share(CEILING) > 0.02 or None)
    finally:
        viewer.server.stop()


def test_the_viewer_lets_in_who_has_its_address_and_nobody_else(run_dir, monkeypatch):
    viser = pytest.importorskip("viser")
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    from dsmap.tools.support.viewer import Cloud, MapViewer

    arrays, poses, _ = read_run(run_dir)
    viewer = MapViewer(Cloud(arrays, 1000), poses, 0, "127.0.0.1", free_port(), "test")
    shared = []
    monkeypatch.setattr(viewer.server, "request_share_url", lambda *a, **k: shared.append(1))
    port, secret = viewer.server.get_port(), viewer.guard.token

    def first_bytes(path: str, **headers) -> int:
        with socket.create_connection(("127.0.0.1", port)) as tcp:
            page = f"ws://localhost:{port}/{path}"
            with connect(
                page, sock=tcp, subprotocols=[f"viser-v{viser.__version__}"], compression=None,
                origin=headers.pop("Origin", None), additional_headers=headers,
            ) as client:  # fmt: skip
                client.send(b"\x81\xa4type\xafShareUrlRequest")
                return len(client.recv(timeout=30))

    try:
        here = f"http://localhost:{port}"
        assert first_bytes(secret) > 0 and first_bytes(secret, Origin=here) > 0
        strangers = [
            ("", {}), ("guessed", {"Origin": here}), ("", {"Origin": here}),
            (secret, {"Origin": "http://evil.example"}), (secret, {"Origin": "null"}),
            (secret, {"Origin": "http://localhost:1"}),
        ]  # fmt: skip
        for path, headers in strangers:
            with pytest.raises(InvalidStatus, match="403"):
                first_bytes(path, **headers)
        assert viewer.guard.refusal(f"/{secret}/", {"Host": f"localhost:{port}"}) is None
        rebound = viewer.guard.refusal(f"/{secret}/", {"Host": f"evil.example:{port}"})
        assert rebound is not None and "evil.example" in rebound
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(here)
        with urllib.request.urlopen(viewer.address) as page:
            assert b"Viser" in page.read() and page.headers["Referrer-Policy"] == "no-referrer"
    finally:
        viewer.server.stop()
    assert not shared, "a page can open no public tunnel"


_FOREIGN = """<body>waiting<script>
const addresses = %s;
const said = [];
addresses.forEach((address, k) => {
    const socket = new WebSocket(address, "viser-v%s");
    const note = (what) => { if (!said[k]) { said[k] = what; }
        if (said.filter(Boolean).length == addresses.length) document.body.innerText = "answers: " + said.join(" "); };
    socket.onopen = () => note("open");
    socket.onmessage = () => note("map");
    socket.onerror = () => note("refused");
});
</script></body>"""


@pytest.mark.slow
def test_a_page_of_foreign_origin_gets_nothing(run_dir, tmp_path):
    """Even one that knows the secret, in a real browser, under both names of this machine."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    viser = pytest.importorskip("viser")
    from dsmap.tools.support.viewer import Cloud, MapViewer

    arrays, poses, _ = read_run(run_dir)
    viewer = MapViewer(Cloud(arrays, 1000), poses, 0, "127.0.0.1", free_port(), "test")
    port, secret = viewer.server.get_port(), viewer.guard.token
    hosts = [f"ws://localhost:{port}", f"ws://127.0.0.1:{port}"]
    addresses = [f"{host}/{path}" for host in hosts for path in ("", secret)]
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "index.html").write_text(_FOREIGN % (json.dumps(addresses), viser.__version__))
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path / "site")
    site = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=site.serve_forever, daemon=True).start()
    try:
        with browser(chromium, tmp_path, f"http://localhost:{site.server_port}/") as page:
            assert wait(lambda: t if "answers" in (t := page.text()) else None) == "answers: " + " ".join(
                ["refused"] * 4
            )
    finally:
        site.shutdown()
        viewer.server.stop()
