"""The scene that options name: a kind of room, or a file of the user's own."""

from pathlib import Path

from dsmap.errors import InputError
from dsmap.sim_scenes.importers.load import SCENE_FORMATS, load_scene
from dsmap.sim_scenes.recording.options import RenderOptions
from dsmap.sim_scenes.rooms.build import SCENES, build_scene, is_scene
from dsmap.sim_scenes.scene import Scene


def open_scene(options: RenderOptions) -> Scene:
    """Build the room of that name and seed, or read the file of that name (the seed then moves the camera only).

    Raises:
        InputError: neither a kind of room nor a readable scene file.
    """
    name = options.scene
    if is_scene(name):
        return build_scene(name, options.seed)
    if Path(name).suffix.lower() not in SCENE_FORMATS:
        raise InputError(
            f"unknown scene {name!r}; expected one of: {', '.join(SCENES)}, flats:2, "
            f"or a file ({', '.join(SCENE_FORMATS)})"
        )
    return load_scene(name, options.class_map, options.up)
