"""The interactive viewer: a point cloud, the camera path and switches in a browser, served by viser."""

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation
from viser import _messages

from dsmap.classes import CLASS_NAMES, PALETTE, colourise
from dsmap.errors import InputError
from dsmap.fusion.objects.boxes import EDGES
from dsmap.fusion.objects.files import NamedBox
from dsmap.fusion.pictures.pictures import confidence_colours, segment_colours, shown_weight, time_colours
from dsmap.fusion.pictures.viewpoint import overview, up_direction
from dsmap.tools.support.viewer_guard import Guard

MODES = ("colour", "label", "segment", "confidence", "time")
_FRUSTA = 24
"""Camera frusta drawn along the path."""


@dataclass
class Cloud:
    """The points that the browser gets: a thinned-out map with the colours of every mode."""

    arrays: dict[str, np.ndarray]
    """Surfel arrays by the names of SurfelMap: the map's N rows at first, then those chosen."""
    max_points: int
    thinning: float = field(init=False)
    """Surfels of the map for each point here, >= 1."""

    def __post_init__(self) -> None:
        count = len(self.arrays["weight"])
        self.thinning = max(1.0, count / self.max_points)
        if count > self.max_points:  # random, as every k-th surfel would show the scan lines of the images
            rows = np.sort(np.random.default_rng(0).choice(count, self.max_points, replace=False))
            self.arrays = {name: values[rows] for name, values in self.arrays.items()}

    def __len__(self) -> int:
        return len(self.arrays["weight"])

    def colours(self, mode: str) -> np.ndarray:
        """RGB of every point, uint8, shape (n, 3), for one of MODES."""
        if mode == "label":
            return colourise(self.arrays["label"])
        if mode == "segment":
            return segment_colours(self.arrays["segment"])
        if mode == "confidence":
            return confidence_colours(self.arrays["weight"])[0]
        if mode == "time":
            return time_colours(self.arrays["t_created"])[0]
        return np.rint(self.arrays["colour"].clip(0, 1) * 255).astype(np.uint8)

    def select(self, classes: set[int], min_confidence: float, eye: np.ndarray | None) -> np.ndarray:
        """Which points to show, bool (n,): of these classes, at least this sure, and facing `eye`, if given."""
        keep = np.isin(self.arrays["label"], sorted(classes)) & (self.arrays["weight"] >= min_confidence)
        if eye is not None:
            towards = np.asarray(eye, np.float32) - self.arrays["position"]
            keep &= (self.arrays["normal"] * towards).sum(axis=1) > 0
        return keep


class MapViewer:
    """Serves a map until `server.stop()`."""

    def __init__(
        self,
        cloud: Cloud,
        poses: np.ndarray,
        min_confidence: float,
        host: str,
        port: int,
        title: str,
        up: np.ndarray | None = None,
        things: Sequence[NamedBox] = (),
    ) -> None:
        """Start the server; only who has its `address` gets in (see `viewer_guard`).

        Args:
            cloud: at least one point.
            poses: T_world_camera of the frames, shape (M, 4, 4).
            min_confidence: first value of the confidence threshold.
            host, port: where to listen; the next free port is taken if this one is in use.
            title: title of the page.
            up: in the world's frame, shape (3,); None: by normals and poses.
            things: boxes to draw, with their names.
        """
        self.cloud = cloud
        shown = self.cloud.arrays
        self.up = up_direction(shown["normal"], poses) if up is None else up
        self.view = overview(shown, poses, 1280, 960, up=self.up)
        self.eye = self.view.T_world_camera[:3, 3]
        self.server, self.guard = guarded_server(host, port, title)
        self.server.scene.set_up_direction(self.up)
        self._place_camera()
        self._add_switches(shown_weight(shown["weight"], min_confidence))
        self._add_path(poses)
        if things:
            self._add_things(things)
        self.points = self.server.scene.add_point_cloud(
            "/map",
            shown["position"],
            self.cloud.colours("colour"),
            point_size=self.size.value / 1000,
            point_shape="circle",
            point_shading="flat",
        )
        self.update()

    @property
    def address(self) -> str:
        """Where a browser of this machine finds the page; nobody gets in without its secret."""
        return f"http://localhost:{self.server.get_port()}/{self.guard.token}/"

    def update(self) -> None:
        """Send what the switches ask for."""
        classes = {i for i, box in self.boxes.items() if box.value}
        eye = self.eye if self.cut.value else None
        keep = self.cloud.select(classes, self.confidence.value, eye)
        with self.server.atomic():
            self.points.points = self.cloud.arrays["position"][keep]
            self.points.colors = self.cloud.colours(self.mode.value)[keep]
            self.points.point_size = self.size.value / 1000
        self.count.content = f"{int(keep.sum()):,} of {len(keep):,} points"

    def _add_switches(self, min_confidence: float) -> None:
        gui, arrays = self.server.gui, self.cloud.arrays
        labelled = bool(arrays["label"].any())
        self.mode = gui.add_dropdown("Colour by", MODES, initial_value="colour")
        # Neighbours are about radius / sqrt(2) apart: this size closes the surface without smearing it.
        closed_mm = 1200 * float(np.median(arrays["radius"])) * self.cloud.thinning**0.5
        size = float(np.clip(round(closed_mm), 2, 40))
        self.size = gui.add_slider("Point size [mm]", 1.0, 40.0, 0.5, size)
        highest = float(np.ceil(max(np.percentile(arrays["weight"], 95), min_confidence, 1)))
        self.confidence = gui.add_slider("Min. confidence", 0.0, highest, 1.0, min_confidence)
        hint = "Hides what faces away from you, so that rooms open up; switch it again after moving."
        self.cut = gui.add_checkbox("Cut away walls", True, hint=hint)
        self.count = gui.add_markdown("")
        self.boxes: dict[int, viser.GuiInputHandle[bool]] = {}
        with gui.add_folder("Classes", visible=labelled):
            for i in np.unique(arrays["label"]).tolist():
                name = CLASS_NAMES[i] if i else "unlabelled"
                gui.add_html(_swatch(i))
                self.boxes[i] = gui.add_checkbox(name, True)
        for control in (self.mode, self.size, self.confidence, *self.boxes.values()):
            control.on_update(lambda _: self.update())
        self.cut.on_update(self._cut_from_here)

    def _cut_from_here(self, event: viser.GuiEvent) -> None:
        if event.client is not None:
            self.eye = np.asarray(event.client.camera.position)
        self.update()

    def _add_path(self, poses: np.ndarray) -> None:
        show = self.server.gui.add_checkbox("Camera path", True)
        scene, centres = self.server.scene, poses[:, :3, 3]
        handles: list = []
        if len(poses) > 1:
            segments = np.stack([centres[:-1], centres[1:]], axis=1)
            handles.append(scene.add_line_segments("/path", segments, (214, 39, 40), thickness=0.008))
        for i in np.unique(np.linspace(0, len(poses) - 1, min(_FRUSTA, len(poses))).astype(int)):
            wxyz = Rotation.from_matrix(poses[i, :3, :3]).as_quat(scalar_first=True)
            handles.append(
                scene.add_camera_frustum(
                    f"/cameras/{i}",
                    fov=0.8,
                    aspect=4 / 3,
                    scale=0.06,
                    thickness=0.004,
                    color=(214, 39, 40),
                    wxyz=wxyz,
                    position=centres[i],
                )  # fmt: skip
            )

        self._switch(show, handles)

    def _add_things(self, things: Sequence[NamedBox]) -> None:
        gui, scene = self.server.gui, self.server.scene
        ends = [one.box.corners()[np.array(EDGES)] for one in things]
        colours = [np.broadcast_to(PALETTE[one.label], (len(EDGES), 2, 3)) for one in things]
        lines = scene.add_line_segments(
            "/things/boxes", np.concatenate(ends), np.concatenate(colours), thickness=0.006
        )
        names = [
            scene.add_label(f"/things/name_{i}", one.name, position=one.box.corners()[-1])
            for i, one in enumerate(things)
        ]
        for title, handles in (("Boxes", [lines]), ("Names", names)):
            self._switch(gui.add_checkbox(title, True), handles)

    def _switch(self, box: Any, handles: Sequence[Any]) -> None:
        """Let a checkbox show and hide parts of the scene."""

        @box.on_update
        def _(_: object) -> None:
            for handle in handles:
                handle.visible = box.value

    def _place_camera(self) -> None:
        forward = self.view.T_world_camera[:3, 2]
        distance = float((np.median(self.cloud.arrays["position"], axis=0) - self.eye) @ forward)
        camera = self.server.initial_camera
        camera.position = self.eye
        camera.look_at = self.eye + forward * max(distance, 0.1)
        camera.up = self.up
        camera.fov = 2 * np.arctan(0.5 * self.view.intrinsics.height / self.view.intrinsics.fy)


def guarded_server(host: str, port: int, title: str) -> tuple[viser.ViserServer, Guard]:
    """A server with an empty page, and the guard before it.

    Raises:
        InputError: viser has changed so that it cannot be guarded.
    """
    guard = Guard(host)
    with contextlib.redirect_stdout(io.StringIO()), guard.in_front():  # the caller says where to look
        server = viser.ViserServer(host=host, port=port, label=f"dsmap: {title}", verbose=False)
    if not guard.at_work:
        server.stop()
        raise InputError(
            f"viser {viser.__version__} cannot be guarded; expected a version of constraints.txt"
        )
    refuse_sharing(server)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    return server, guard


def refuse_sharing(server: viser.ViserServer) -> None:
    """Let no message of a page open a public tunnel to this server."""
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(message)


def _swatch(i: int) -> str:
    r, g, b = PALETTE[i].tolist()
    style = f"height:8px;width:34%;margin-left:1em;border-radius:3px;background:rgb({r},{g},{b})"
    return f'<div style="{style}"></div>'
