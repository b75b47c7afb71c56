"""The page of a live session: the map as it grows, the camera, the frame beside its labels, health, and buttons.

The mapper hands over what changed, at most ten times a second and only when the page's thread has done with what it
had; that thread, which stands aside for the mapper's, merges and sends. So neither a slow browser nor a large map can
hold up mapping, and what is sent is bounded.
"""

import queue
import threading
import time
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
import viser
from scipy.spatial.transform import Rotation

from dsmap.classes import VOID, colourise
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.runs.map_live import Controls, Moment
from dsmap.kernels.launch import step_aside
from dsmap.tools.live.shown_map import CHUNK_M, ShownMap, ShownPoints
from dsmap.tools.support.viewer import guarded_server

UPDATE_S = 0.1
"""Least time between two updates [s]."""
BUDGET = 12_000
"""Points sent in an update, about: with 9 bytes a point 1.1 MB a second at most."""
_ALL_AGAIN_S = 5.0
"""So often the whole map is compared with what is shown: surfels that were dropped go."""
_IMAGE_S = 0.3
_IMAGE_WIDTH = 240
_STABLE_SHOWN = 0.2
"""Surfels of this share of the stable weight are shown: the youngest are mostly noise."""
_RED = (214, 39, 40)


@dataclass(frozen=True)
class _News:
    """What the mapper hands over."""

    moment: Moment
    points: ShownPoints
    whole: bool
    """These are all there are."""
    surfels: int
    image: np.ndarray | None
    """The frame beside its labels, RGB."""
    up: np.ndarray | None
    focal: tuple[float, float]
    """Vertical field of view [rad] and aspect of the camera."""


class LivePage:
    """Serves a page until `close`.

    Args:
        host, port: where to listen; the next free port is taken if this one is in use.
        title: title of the page.
        controls: what the buttons set.
    """

    def __init__(self, host: str, port: int, title: str, controls: Controls):
        self.controls = controls
        self.updates = 0
        """Updates sent so far."""
        self.delays: deque[float] = deque(maxlen=3000)
        """From the camera to the page, of the newest updates [s]."""
        self._shown = ShownMap()
        self._nodes: dict[tuple[int, int, int], viser.PointCloudHandle] = {}
        self._news: queue.Queue[_News | None] = queue.Queue(1)
        self._since, self._last, self._whole_at, self._image_at = -1, 0.0, 0.0, 0.0
        self._again = threading.Event()
        self.server, self.guard = guarded_server(host, port, title)
        self._add_panel()
        self._camera: viser.CameraFrustumHandle | None = None
        self._way: list[np.ndarray] = []
        self._path: viser.LineSegmentsHandle | None = None
        self._idle = threading.Event()
        self._idle.set()
        self._thread = threading.Thread(target=self._work, name="dsmap-page", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Where a browser of this machine finds the page; nobody gets in without its secret."""
        return f"http://localhost:{self.server.get_port()}/{self.guard.token}/"

    def show(self, mapper: Mapper, moment: Moment) -> None:
        """Hand over what a step changed, if it is time to; called by the mapper's thread."""
        now = time.monotonic()
        if not self._idle.is_set() or now - self._last < UPDATE_S:
            if moment.result.loop is not None:
                self._whole_at = 0.0  # everything has moved
            return
        whole = now - self._whole_at > _ALL_AGAIN_S or moment.result.loop is not None
        surfels = mapper.surfels.numpy()
        kept = surfels["weight"] >= _STABLE_SHOWN * mapper.config.stable_weight
        if not whole:
            kept &= surfels["t_updated"] >= self._since
        k = mapper.intrinsics
        image = None
        if now - self._image_at > _IMAGE_S:
            image, self._image_at = _beside_labels(mapper, moment.arrived.frame.rgb), now
        news = _News(
            moment, ShownPoints.of(surfels, np.flatnonzero(kept)), whole, len(kept), image,
            mapper.up if whole else None,
            (2 * float(np.arctan(0.5 * k.height / k.fy)), k.width / k.height),
        )  # fmt: skip
        self._since, self._last = mapper.time, now
        if whole:
            self._whole_at = now
        self._idle.clear()
        self._news.put(news)

    def say(self, text: str) -> None:
        """Show a line above the figures."""
        self._said.content = text

    def close(self) -> None:
        """End the page, after what it still has to show."""
        self._news.put(None)
        self._thread.join(5)
        self.server.stop()

    def _add_panel(self) -> None:
        gui = self.server.gui
        self._said = gui.add_markdown("waiting for the first frame")
        self._figures = gui.add_markdown("")
        blank = np.zeros((_IMAGE_WIDTH // 2, 2 * _IMAGE_WIDTH, 3), np.uint8)
        self._image = gui.add_image(blank, label="frame and the map's labels", format="jpeg")
        self._mode = gui.add_dropdown("Colour by", ("colour", "label"), initial_value="colour")
        self._size = gui.add_slider("Point size [mm]", 1.0, 40.0, 0.5, 8.0)
        pause, save, stop = gui.add_button("Pause"), gui.add_button("Save now"), gui.add_button("Stop")
        self._pause = pause

        @pause.on_click
        def _(_: object) -> None:
            paused = self.controls.paused
            paused.clear() if paused.is_set() else paused.set()
            pause.label = "Go on" if paused.is_set() else "Pause"
            self.say("paused" if paused.is_set() else "mapping")

        @save.on_click
        def _(_: object) -> None:
            self.controls.save.set()

        @stop.on_click
        def _(_: object) -> None:
            self.controls.stop.set()
            self.say("stopped: writing the map")

        for control in (self._mode, self._size):
            control.on_update(lambda _: self._again.set())

    def _work(self) -> None:
        step_aside()
        while True:
            try:
                news = self._news.get(timeout=UPDATE_S)
            except queue.Empty:
                self._send_chunks()  # what the last updates left over
                continue
            if news is None:
                return
            try:
                self._update(news)
            finally:
                self._idle.set()

    def _update(self, news: _News) -> None:
        if news.whole:
            self._shown.replace(news.points)
        else:
            self._shown.add(news.points)
        with self.server.atomic():
            self._send_chunks()
            self._send_camera(news)
            if news.image is not None:
                self._image.image = news.image
            self.updates += 1
            self.delays.append(time.monotonic() - news.moment.arrived.at)
            self._figures.content = self._text(news)

    def _send_chunks(self) -> None:
        if self._again.is_set():
            self._again.clear()
            self._shown.touch_all()
        for chunk, points in self._shown.take(BUDGET):
            old = self._nodes.pop(chunk, None)
            if points is None or not len(points):
                if old is not None:
                    old.remove()
                continue
            corner = CHUNK_M * np.array(chunk)
            colours = colourise(points.label) if self._mode.value == "label" else points.colour
            self._nodes[chunk] = self.server.scene.add_point_cloud(  # one of the same name is replaced
                "/map/" + "_".join(map(str, chunk)),
                (points.position - corner).astype(np.float32),
                colours,
                point_size=max(self._size.value / 1000, 0.8 * self._shown.cell),
                point_shape="circle",
                position=corner,
            )

    def _send_camera(self, news: _News) -> None:
        T = news.moment.result.T_world_camera
        wxyz = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        if news.up is not None:
            self.server.scene.set_up_direction(news.up)
        if self._camera is None:
            self._camera = self.server.scene.add_camera_frustum(
                "/camera",
                fov=news.focal[0],
                aspect=news.focal[1],
                scale=0.15,
                color=_RED,
                wxyz=wxyz,
                position=T[:3, 3],
            )
            up = news.up if news.up is not None else -T[:3, 1]
            start = self.server.initial_camera
            start.up, start.look_at = up, T[:3, 3] + 1.5 * T[:3, 2]
            start.position = T[:3, 3] - 1.5 * T[:3, 2] + 0.8 * up
        self._camera.wxyz, self._camera.position = wxyz, T[:3, 3]
        if not self._way or np.linalg.norm(self._way[-1] - T[:3, 3]) > 0.02:
            self._way.append(T[:3, 3].copy())
        if news.whole and len(self._way) > 1:
            way = np.array(self._way)
            segments = np.stack([way[:-1], way[1:]], axis=1)
            self._path = self.server.scene.add_line_segments("/path", segments, _RED, thickness=0.006)

    def _text(self, news: _News) -> str:
        moment, result = news.moment, news.moment.result
        state = "tracked" if result.tracked else f"**LOST: {result.reason}**"
        health = result.health
        rms = (
            f", {1e3 * health.rms_icp:.1f} mm off"
            if health is not None and hasattr(health, "rms_icp")
            else ""
        )
        recent = sorted(list(self.delays)[-30:])
        lines = [
            f"frame {moment.arrived.frame.index}: {state}{rms}",
            f"{news.surfels:,} surfels, {len(self._shown):,} points",
            f"delay {1e3 * recent[len(recent) // 2]:.0f} ms to the page, {1e3 * moment.delay_s:.0f} ms to the map",
            f"{moment.dropped} frames dropped",
        ]
        return "  \n".join(lines)


def _beside_labels(mapper: Mapper, rgb: np.ndarray) -> np.ndarray:
    """The frame beside the classes of the map's last view, RGB."""
    height = round(_IMAGE_WIDTH * rgb.shape[0] / rgb.shape[1])
    left = cv2.resize(rgb, (_IMAGE_WIDTH, height), interpolation=cv2.INTER_AREA)
    index = mapper.model.maps.index.numpy()
    index = cv2.resize(
        index.astype(np.float64), (_IMAGE_WIDTH, height), interpolation=cv2.INTER_NEAREST
    ).astype(int)
    label = mapper.surfels.numpy()["label"]
    seen = (index >= 0) & (index < len(label))
    ids = np.where(seen, label[np.where(seen, index, 0)] if len(label) else VOID, VOID)
    return np.concatenate([left, colourise(ids)], axis=1)
