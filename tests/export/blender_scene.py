"""Run by a Python that has bpy: import what a test wrote through the add-on's operator, and tell what is in
Blender.

One JSON argument: {"addon", "folder", "files", "then": [files of another import, ...], "views": {name: camera
position}, "side", "with_light": whether the folder's light comes with a mesh}. Files named "new scene" begin
another scene in the same file. The answer is the last line.
"""

import importlib.util
import json
import sys
from pathlib import Path

import bpy
from mathutils import Vector


def load_addon(path):
    spec = importlib.util.spec_from_file_location("lightprobe_import", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def lamp(item):
    towards = item.matrix_world.to_3x3() @ Vector((0, 0, 1))
    data = item.data
    return {"energy": data.energy, "color": list(data.color), "angle": data.angle, "towards": list(towards)}


def middle_pixel(position, target, folder, side):
    """Render a small picture from `position` and return its middle pixel, linear."""
    scene = bpy.context.scene
    if scene.camera is None:
        scene.camera = bpy.data.objects.new("view", bpy.data.cameras.new("view"))
        scene.collection.objects.link(scene.camera)
    scene.camera.location = position
    scene.camera.rotation_euler = (Vector(target) - Vector(position)).to_track_quat("-Z", "Y").to_euler()
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 64, "CPU"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(Path(folder) / "view.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    middle = 4 * (side // 2 * side + side // 2)
    pixel = list(image.pixels[middle : middle + 3])
    bpy.data.images.remove(image)
    return pixel


def main(given):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon = load_addon(given["addon"])
    addon.register()
    try:
        for names in (given["files"], *given.get("then", [])):
            if names == ["new scene"]:
                bpy.context.window.scene = bpy.data.scenes.new("another")
                continue
            files = [{"name": name} for name in names]
            options = {name: given[name] for name in ("with_light",) if name in given}
            result = list(bpy.ops.import_scene.lightprobe(directory=given["folder"], files=files, **options))
    except RuntimeError as error:
        print(json.dumps({"error": str(error), "objects": len(bpy.data.objects)}))
        return
    bpy.context.view_layer.update()
    meshes = [item for item in bpy.data.objects if item.type == "MESH"]
    corners = [item.matrix_world @ vertex.co for item in meshes for vertex in item.data.vertices]
    world = bpy.context.scene.world
    nodes = [] if world is None else world.node_tree.nodes
    images = [node.image.filepath for node in nodes if node.type == "TEX_ENVIRONMENT"]
    shaders = [n for m in bpy.data.materials for n in m.node_tree.nodes if n.type == "BSDF_PRINCIPLED"]
    lamps = [lamp(item) for item in bpy.data.objects if item.type == "LIGHT"]
    views = given.get("views", {})
    answer = {
        "result": result,
        "map": images,
        "lamps_by_scene": [
            sum(item.type == "LIGHT" for item in scene.collection.all_objects) for scene in bpy.data.scenes
        ],
        "lamps": lamps,
        "distributions": [node.distribution for node in shaders],
        "low": [min(c[i] for c in corners) for i in range(3)] if corners else None,
        "high": [max(c[i] for c in corners) for i in range(3)] if corners else None,
        "view_transform": bpy.context.scene.view_settings.view_transform,
        "pixels": {
            name: middle_pixel(position, given["target"], given["folder"], given["side"])
            for name, position in views.items()
        },
    }
    addon.unregister()
    print(json.dumps(answer))


main(json.loads(sys.argv[-1]))
