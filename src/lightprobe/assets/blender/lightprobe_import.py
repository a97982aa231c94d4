"""Blender add-on: an object of `lightprobe export` and a light of `lightprobe predict`, with sun lamps.

Install it with Edit > Preferences > Add-ons > Install from Disk; it is then in File > Import > lightprobe. It
also runs as a module of Blender's own Python:

    import lightprobe_import
    lightprobe_import.import_object("files/mesh.glb")
    lightprobe_import.import_light("light.exr")

Nothing needs a turn: mesh and map are in the frame of the photos' cameras, z up, which is Blender's own.
"""

import json
import math
import struct
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper
from mathutils import Vector

bl_info = {
    "name": "lightprobe import",
    "author": "the lightprobe authors",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "File > Import > lightprobe",
    "description": "Import an object with the light around it: GLB, environment map, suns and lamps",
    "category": "Import-Export",
}

_NAME = "lightprobe light"  # of the world and of the collection of lamps
_OWN = "lightprobe_lamps"  # property of such a collection, which users may rename and move
_FORMAT, _VERSION = "lightprobe light", 1  # of a .light.json
_MAPS = (".exr", ".hdr")
_LARGEST_JSON = 2**24  # bytes
_LARGEST_HEADER = 2**14  # bytes of an OpenEXR file in which its primaries are looked for
_PRIMARIES = b"chromaticities\0chromaticities\0"  # name and type of the attribute
_AP1 = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)  # ACEScg's
_MOST_LAMPS = 64  # that a file may bring; lightprobe writes at most eight


class LightFileError(Exception):
    """A .light.json that cannot be used; the message says which and why."""


def import_object(path: Path | str) -> list[Any]:
    """Import a GLB file and return its objects, their materials with glTF's own reflection.

    Blender's importer leaves its default distribution, which adds light scattered many times between the grains of
    rough surfaces. Neither glTF's material nor lightprobe's fit to the photos has that light: rough gold would be
    brighter. Suns are as bright as in the file, in the unit of the maps; by default the importer takes their
    intensity for lux and divides by 683.
    """
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(path), export_import_convert_lighting_mode="COMPAT")
    found = [item for item in bpy.data.objects if item not in before]
    for item in found:
        for slot in item.material_slots:
            for node in slot.material.node_tree.nodes if slot.material is not None else ():
                if node.type == "BSDF_PRINCIPLED":
                    node.distribution = "GGX"
    return found


def import_light(path: Path | str) -> list[Any]:
    """Make an equirectangular map the world's light, and return the sun lamps of the .light.json beside it.

    There are lamps only where the file says that the map was written without them, so that none shines twice.
    """
    path = Path(path)
    lamps = lamps_beside(path)
    for lamp in list(_collection().objects):  # those of the light before
        bpy.data.objects.remove(lamp)
    set_world(path)
    return [_add_lamp(lamp, i) for i, lamp in enumerate(lamps)]


def set_world(path: Path) -> None:
    """Light the scene with an equirectangular map from all sides, as its radiance is."""
    world = bpy.data.worlds.new(_NAME)
    if world.node_tree is None:
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    nodes.clear()
    texture = nodes.new("ShaderNodeTexEnvironment")
    background, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputWorld")
    texture.image = bpy.data.images.load(str(path), check_existing=True)
    texture.image.reload()  # the file may have been written anew
    if _is_acescg(path):
        texture.image.colorspace_settings.name = "ACEScg"  # Blender does not look at a file's primaries
    texture.projection, texture.interpolation = "EQUIRECTANGULAR", "Linear"
    links.new(texture.outputs["Color"], background.inputs["Color"])
    links.new(background.outputs["Background"], output.inputs["Surface"])
    for x, node in enumerate((texture, background, output)):
        node.location = (300 * x, 0)
    bpy.context.scene.world = world


def _is_acescg(path: Path) -> bool:
    """Return whether a map is an OpenEXR file that names ACEScg's primaries."""
    with path.open("rb") as file:
        head = file.read(_LARGEST_HEADER)
    place = head.find(_PRIMARIES) + len(_PRIMARIES) + 4  # bytes: of its size
    if path.suffix.lower() != ".exr" or _PRIMARIES not in head or len(head) < place + 32:
        return False
    return all(abs(a - b) < 0.002 for a, b in zip(struct.unpack_from("<8f", head, place), _AP1, strict=True))


def lamps_beside(path: Path) -> list[dict[str, Any]]:
    """Return the suns and lamps that the map at `path` was written without, from NAME.light.json.

    Each has "direction" (unit, towards it), "angular_radius_deg" and "irradiance_rgb". Raises
    `LightFileError`.
    """
    file = path.with_name(f"{path.stem}.light.json")
    if not file.is_file():
        return []
    if file.stat().st_size > _LARGEST_JSON:
        raise LightFileError(f"{file} is too large for a light file")
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
        if (stored["format"], stored["version"]) != (_FORMAT, _VERSION):
            raise LightFileError(
                f"{file} is no light file of version {_VERSION}; remove it to import the map alone"
            )
        told = stored["map"]
        name = str(told.get("file", path.name))
        others = Path(name).stem == path.stem and path.name not in (name, *told.get("copies", []))
        if told.get("sun") != "separate" or others:  # NAME.exr and NAME.hdr share NAME.light.json
            return []
        return [_checked(lamp) for lamp in stored["sources"][:_MOST_LAMPS]]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise LightFileError(f"{file} is no light file of lightprobe: {error!r}") from error


def _checked(lamp: dict[str, Any]) -> dict[str, Any]:
    direction = Vector([float(value) for value in lamp["direction"]])
    color = [float(value) for value in lamp["irradiance_rgb"]]
    radius = float(lamp["angular_radius_deg"])
    numbers = [*direction, *color, radius]
    if len(numbers) != 7 or not all(map(math.isfinite, numbers)) or direction.length == 0 or min(color) < 0:
        raise ValueError("no lamp has such numbers")
    return {"direction": direction.normalized(), "irradiance_rgb": color, "angular_radius_deg": radius}


def _add_lamp(lamp: dict[str, Any], index: int) -> Any:
    """Add a sun lamp: its strength is the irradiance of a surface that faces it, as the file's is."""
    color = lamp["irradiance_rgb"]
    strength = max(color)
    data = bpy.data.lights.new(f"lightprobe source {index + 1}", "SUN")
    data.energy = strength
    data.color = [value / strength for value in color] if strength > 0 else (1, 1, 1)
    data.angle = min(math.radians(2 * lamp["angular_radius_deg"]), math.pi)
    item = bpy.data.objects.new(data.name, data)
    item.rotation_euler = lamp["direction"].to_track_quat("Z", "Y").to_euler()  # a lamp shines along its -z
    item.location = 10 * lamp["direction"]  # where it is does not matter, but shows where it shines from
    _collection().objects.link(item)
    return item


def _collection() -> Any:
    """Return the present scene's collection of lamps; other scenes keep their own."""
    root = bpy.context.scene.collection
    found = next((one for one in root.children_recursive if one.get(_OWN) or one.name == _NAME), None)
    if found is None:
        found = bpy.data.collections.new(_NAME)
        found[_OWN] = True
        root.children.link(found)
    return found


def set_plain_colors() -> None:
    """Show linear radiance by the sRGB curve alone, as lightprobe's pictures do, and not by a film's."""
    view = bpy.context.scene.view_settings
    view.view_transform, view.look = "Standard", "None"
    view.exposure, view.gamma = 0, 1


def light_of(mesh: Path) -> Path | None:
    """Return the map of an exported mesh: light.exr or .hdr beside it, else the first one in env/."""
    beside = [mesh.with_name(f"light{suffix}") for suffix in _MAPS]
    folder = mesh.parent / "env"
    stored = sorted(path for path in folder.glob("*") if path.suffix.lower() in _MAPS)
    return next((path for path in (*beside, *stored) if path.is_file()), None)


class LIGHTPROBE_OT_import(bpy.types.Operator, ImportHelper):  # noqa: N801 (as Blender names operators)
    """Import an object that lightprobe exported, with the light around it."""

    bl_idname = "import_scene.lightprobe"
    bl_label = "Import lightprobe"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 (as Blender reads it)

    filter_glob: StringProperty(default="*.glb;*.exr;*.hdr", options={"HIDDEN"})  # type: ignore[valid-type]
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN"})  # type: ignore[valid-type]
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN"})  # type: ignore[valid-type]
    with_light: BoolProperty(  # type: ignore[valid-type]
        name="Light of the folder",
        default=True,
        description="With a mesh alone, also import light.exr beside it, or the first map in env",
    )
    plain_colors: BoolProperty(  # type: ignore[valid-type]
        name="Plain sRGB",
        default=True,
        description="Set the view transform to Standard, to compare with photos",
    )

    def execute(self, context: Any) -> set[str]:
        """Import the chosen files."""
        named = [Path(self.directory, item.name) for item in self.files if item.name]
        chosen = named or [Path(self.filepath)]
        meshes = [path for path in chosen if path.suffix.lower() == ".glb"]
        maps = [path for path in chosen if path.suffix.lower() in _MAPS]
        if self.with_light and meshes and not maps:
            maps = [path for path in (light_of(meshes[0]),) if path is not None]
        if not meshes and not maps:
            self.report({"ERROR"}, "Choose a .glb file, an .exr or .hdr map, or both")
            return {"CANCELLED"}
        try:
            for path in maps[:1]:
                lamps_beside(path)  # one that cannot be used is told before anything is imported
            objects = [item for path in meshes for item in import_object(path)]
            lamps = [lamp for path in maps[:1] for lamp in import_light(path)]
        except (LightFileError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if lamps:  # scene.glb has the same ones, in glTF's form, which knows no size
            bpy.data.batch_remove([item for item in objects if item.type == "LIGHT"])
        if self.plain_colors:
            set_plain_colors()
        return {"FINISHED"}


def _menu(self: Any, context: Any) -> None:
    self.layout.operator(LIGHTPROBE_OT_import.bl_idname, text="lightprobe (.glb, .exr, .hdr)")


def register() -> None:
    """Add the entry to Blender's File > Import."""
    bpy.utils.register_class(LIGHTPROBE_OT_import)
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    """Take it out again."""
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
    bpy.utils.unregister_class(LIGHTPROBE_OT_import)
