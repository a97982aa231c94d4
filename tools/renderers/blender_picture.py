"""Render an exported object in Blender: run by the Python that has `bpy`, with one JSON argument.

    python tools/renderers/blender_picture.py '{"addon": ..., "mesh": ..., "map": ..., "camera": {...}, ...}'

It writes the linear premultiplied picture as EXR, and the same through Blender's view transform as PNG.
"""

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix


def load_addon(path: str) -> Any:
    """Return the add-on as a module."""
    spec = importlib.util.spec_from_file_location("lightprobe_import", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def add_camera(camera: dict[str, Any]) -> None:
    """Make the scene's camera that of a lightprobe camera: pinhole, OpenGL axes, intrinsics in pixels."""
    width, height = camera["width"], camera["height"]
    data = bpy.data.cameras.new("view")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
    data.lens = camera["fx"] / width * data.sensor_width
    data.shift_x = (width / 2 - camera["cx"]) / width
    data.shift_y = (camera["cy"] - height / 2) / width * camera["fx"] / camera["fy"]
    data.clip_start, data.clip_end = 1e-3, 1e4
    item = bpy.data.objects.new("view", data)
    item.matrix_world = Matrix(camera["camera_to_world"])
    scene = bpy.context.scene
    scene.collection.objects.link(item)
    scene.camera = item
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.pixel_aspect_y = camera["fx"] / camera["fy"]


def main(given: dict[str, Any]) -> None:
    """Import, render and write."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon = load_addon(given["addon"])
    addon.import_object(given["mesh"])
    addon.import_light(given["map"])
    addon.set_plain_colors()
    add_camera(given["camera"])
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", given["samples"], 0
    scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = False, False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.max_bounces = given.get("bounces", 4)
    scene.render.film_transparent = True
    scene.render.threads_mode, scene.render.threads = "FIXED", given.get("threads", 1)
    settings = scene.render.image_settings
    for suffix, kind, depth in ((".exr", "OPEN_EXR", "32"), (".png", "PNG", "8")):
        settings.file_format, settings.color_mode, settings.color_depth = kind, "RGBA", depth
        path = str(Path(given["output"]).with_suffix(suffix))
        if suffix == ".exr":
            scene.render.filepath = path
            bpy.ops.render.render(write_still=True)
        else:
            bpy.data.images["Render Result"].save_render(path)


if __name__ == "__main__":
    main(json.loads(sys.argv[-1]))
