"""What a synthetic room is, whatever renders it: labelled meshes, materials, lights, things to look at."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dsmap.classes import CLASS_NAMES
from dsmap.sim_scenes.geometry.shapes import Shape, Vector, merged, rotation_z


@dataclass(frozen=True)
class Material:
    """How a surface looks."""

    texture: np.ndarray
    """uint8 (rows, columns, 3); row 0 is v = 0."""
    tile: float
    """Metres that the texture spans along u and v; 1 where the shape's uv already run from 0 to 1."""
    specular: float = 0.1
    shininess: float = 0.3
    """0 = dull, 1 = polished; a physically based renderer takes it for 1 - roughness."""
    emission: float = 0.0
    glass: bool = False
    """A depth sensor sees nothing here (window panes, screens)."""
    metallic: float = 0.0
    """0..1; only physically based renderers tell metals from others."""


MAX_LIGHTS = 10
"""Most lights of a scene: the ray tracer is compiled for their number."""
LEAK = 0.12
"""Share of a light that comes through to where it is shadowed: what walls scatter."""
TopArea = tuple[float, float, float, float, float]
"""Where things may stand on a piece: x0, y0, x1, y1, z [m], in its frame."""


@dataclass(frozen=True)
class Light:
    """A point light, a spot light (`direction` and `cutoff`), or a directional one (`direction` alone).

    Colours are 0..1.
    """

    position: np.ndarray
    diffuse: np.ndarray
    specular: np.ndarray
    direction: np.ndarray | None = None
    shadow: bool = True
    reach: float | None = None
    """Distance at which the light has half its power [m], as 1 / (1 + (d / reach)^2); None = no falloff."""
    cutoff: float | None = None
    """Half the opening angle of a spot light [deg]."""


@dataclass(frozen=True)
class Room:
    """One room of a scene: an axis-aligned box with its floor at z = 0."""

    kind: str
    """Name of the room kind: living_room, bedroom, office, kitchen, bathroom, corridor."""
    low: np.ndarray
    """Inner corner of smallest x, y [m], shape (2,)."""
    high: np.ndarray
    """Inner corner of largest x, y [m], shape (2,)."""
    height: float
    """Of the ceiling [m]."""


@dataclass(frozen=True)
class Door:
    """A way through a wall between two rooms of a scene: an open or ajar door, or an opening without one."""

    centre: np.ndarray
    """Middle of the opening on the floor, halfway through the wall [m], shape (2,)."""
    normal: np.ndarray
    """Unit vector along the way through, from `rooms[0]` into `rooms[1]`, shape (2,)."""
    width: float
    """Free width [m]."""
    rooms: tuple[int, int]
    """Indices into `Scene.rooms`."""


@dataclass(frozen=True)
class Part:
    """One mesh in world coordinates, of one material, class and instance."""

    shape: Shape
    material: str
    label: int
    instance: int
    body: int = 0
    """0 = part of the static world; k = moves with `scene.bodies[k - 1]`, and is given as it stands at rest."""


@dataclass(frozen=True)
class Body:
    """A thing that can move as a whole, relative to the world."""

    name: str
    instance: int
    T_world_rest: np.ndarray
    """Where its frame is while its parts are where `Scene.parts` has them, shape (4, 4)."""


@dataclass(eq=False)
class Assembly:
    """A piece of furniture in its own frame: floor centre at the origin, front towards -y, z up."""

    label: str
    """Class of the parts that say nothing else."""
    parts: list[tuple[Shape, str, str, int]] = field(default_factory=list)
    """(shape, material, class, item): item 0 is the piece itself, others are things standing on it."""
    surfaces: list[TopArea] = field(default_factory=list)
    """Where things may stand."""
    items: int = 1
    name: str = ""
    """What it is, where its class does not say it: the name of the function that made it."""

    def add(self, shape: Shape, material: str, label: str | None = None) -> None:
        """Add a part of the piece itself."""
        self.parts.append((shape, material, label or self.label, 0))

    def attach(self, other: "Assembly", xyz: Vector, yaw: float = 0.0) -> None:
        """Stand another assembly (with all that is on it) on this one, as instances of its own."""
        for shape, material, label, item in other.parts:
            self.parts.append((shape.moved(xyz, yaw), material, label, self.items + item))
        self.items += other.items

    def reshape(self, change: Callable[[Shape], Shape]) -> None:
        """Change the shape of every part."""
        self.parts = [(change(shape), material, label, item) for shape, material, label, item in self.parts]

    def bounds(self) -> np.ndarray:
        """Lowest and highest corner in its own frame [m], shape (2, 3)."""
        corners = np.array([shape.bounds() for shape, *_ in self.parts])
        return np.array([corners[:, 0].min(0), corners[:, 1].max(0)])

    def size(self) -> np.ndarray:
        """Width (x), depth (y), height (z) [m], of the box about the origin that holds it."""
        low, high = self.bounds()
        return np.array([*(2 * np.maximum(np.abs(low[:2]), np.abs(high[:2]))), high[2]])


@dataclass(frozen=True)
class Piece:
    """An assembly that was put into a scene."""

    name: str
    room: int
    """Index into `Scene.rooms`."""
    instance: int
    """Of the piece itself; the things that stand on it have the numbers that follow, `assembly.items` in all."""
    T_world_piece: np.ndarray
    """Shape (4, 4)."""
    assembly: Assembly


@dataclass
class Scene:
    """Rooms ready to be rendered. Metres; z is up, the floor at 0, the middle of all rooms at x = y = 0."""

    name: str
    seed: int
    size: np.ndarray
    """Inner width (x), depth (y), height (z) of the room; of the box around all rooms where there are several."""
    materials: dict[str, Material]
    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    ambient: np.ndarray = field(default_factory=lambda: np.full(3, 0.3))
    targets: list[np.ndarray] = field(default_factory=list)
    """Points worth looking at; the first is the room's main piece."""
    instances: int = 0
    rooms: list[Room] = field(default_factory=list)
    """One, or all rooms of a flat; a scene that was imported may have none."""
    doors: list[Door] = field(default_factory=list)
    """Ways between the rooms; closed doors and doors that lead outside are not among them."""
    pieces: list[Piece] = field(default_factory=list)
    """Every assembly in its order; what physics and checks work on (`parts` is what is rendered)."""
    bodies: list[Body] = field(default_factory=list)
    """What can move; empty unless `moving.add_mover` was asked for something."""

    def place(
        self, assembly: Assembly, xyz: Sequence[float], yaw: float = 0.0, name: str = "", room: int = 0
    ) -> None:
        """Stand an assembly upright at `xyz`, turned by `yaw`; see `put`."""
        T_world_piece = np.eye(4)
        T_world_piece[:3, :3], T_world_piece[:3, 3] = rotation_z(yaw), xyz
        self.put(assembly, T_world_piece, name, room)

    def put(self, assembly: Assembly, T_world_piece: np.ndarray, name: str = "", room: int = 0) -> None:
        """Put an assembly into a room; its items become instances, its parts merge by material and class."""
        turn, shift = T_world_piece[:3, :3], T_world_piece[:3, 3]
        groups: dict[tuple[int, str, str], list[Shape]] = {}
        for shape, material, label, item in assembly.parts:
            groups.setdefault((item, material, label), []).append(shape.turned(turn).moved(shift))
        for (item, material, label), shapes in groups.items():
            instance = self.instances + 1 + item
            self.parts.append(Part(merged(shapes), material, CLASS_NAMES.index(label), instance))
        first = self.instances + 1
        self.pieces.append(
            Piece(name or assembly.name or assembly.label, room, first, T_world_piece, assembly)
        )
        self.instances += assembly.items

    def surface(self, moving: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """All meshes as one: vertices (N, 3), faces (F, 3), class of each face (F,), instance of each face (F,).

        `moving=False` leaves out the parts of `bodies`; otherwise they are there as they stand at rest.
        """
        parts = [p for p in self.parts if moving or p.body == 0]
        whole = merged([p.shape for p in parts])
        counts = [len(p.shape.faces) for p in parts]
        labels = np.repeat(np.array([p.label for p in parts], np.uint8), counts)
        instances = np.repeat(np.array([p.instance for p in parts], np.uint16), counts)
        return whole.vertices, whole.faces, labels, instances

    def moved_by(self, T_world_body: np.ndarray | None) -> dict[int, np.ndarray]:
        """What takes the vertices of each moving part from rest to now, by part index: shape (4, 4) each.

        Args:
            T_world_body: poses of `bodies` now, shape (bodies, 4, 4); None = at rest.
        """
        if T_world_body is None:
            T_world_body = np.array([body.T_world_rest for body in self.bodies])
        moved = [
            now @ np.linalg.inv(b.T_world_rest) for now, b in zip(T_world_body, self.bodies, strict=True)
        ]
        return {i: moved[part.body - 1] for i, part in enumerate(self.parts) if part.body}
