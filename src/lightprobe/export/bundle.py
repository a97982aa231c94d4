"""A decomposition in files for other programs: GLB, USD, textures and environment maps, user's frame."""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from lightprobe.core.config.export import ExportOptions
from lightprobe.core.config.prediction import Sun
from lightprobe.core.files import named_file, write_bytes
from lightprobe.core.run import RunFolder
from lightprobe.export.glb import DirectionalLight, GltfPictures, write_glb
from lightprobe.export.gltf_mesh import GltfMesh, gltf_mesh
from lightprobe.export.image_based_light import ImageBasedLight
from lightprobe.export.light_file import write_sources
from lightprobe.export.materialx import check_materialx, write_materialx
from lightprobe.export.pictures import NAMES, write_pictures
from lightprobe.export.ultra_hdr import write_ultra_hdr
from lightprobe.export.usd import check_usd, write_usd
from lightprobe.light.environment import Environment
from lightprobe.light.files import write_map
from lightprobe.light.sources import LightSource
from lightprobe.light.upsampling import resized_map
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Similarity

_USUAL = ExportOptions()
ADDON = "lightprobe_import.py"  # for Blender


@dataclass(frozen=True)
class SceneLight:
    """A light that the object is exported under: a map, with lamps that are left out of it, or inside it."""

    image: np.ndarray  # (H, 2H, 3) float32 >= 0, equirectangular
    lamps: tuple[LightSource, ...]
    inside: tuple[LightSource, ...] = ()


def write_mesh(asset: Asset, similarity: Similarity, glb: Path) -> tuple[GltfMesh, GltfPictures]:
    """Write the textured mesh as a GLB file with base_color.png, orm.png and normal.png; return its parts.

    Positions are in the user's frame and units, turned to glTF's y-up axes.
    """
    pictures = write_pictures(asset, glb.parent)
    mesh = gltf_mesh(asset.mesh, similarity)
    write_glb(glb, mesh, pictures)
    return mesh, pictures


def write_run_outputs(decomposition: Decomposition, run: RunFolder) -> None:
    """Write RUN/mesh and RUN/env: what Phase I leaves for other programs."""
    write_mesh(decomposition.asset, decomposition.similarity, run.mesh_folder / "object.glb")
    for photo, light in decomposition.lights.items():
        light.save(run.environment_file(photo))


def export(
    decomposition: Decomposition,
    folder: Path,
    environments: dict[str, Environment],
    *,
    light: SceneLight | None = None,
    options: ExportOptions = _USUAL,
) -> list[Path]:
    """Write the object and its lights for other programs; return the files written, mesh.glb first.

    mesh.glb and its textures, and each of `environments`, by photo, as EXR and HDR under env/. With a `light`, also
    light.exr, light.hdr, light.jpg (Ultra HDR), its lamps in light.light.json, and scene.glb, the mesh with the lamps
    and the map. As USD, scene.usdc and scene.usdz hold the mesh with the light, if there is one; material.mtlx is the
    material as MaterialX. Raises `ConfigError` when the library of either is missing, before anything is written.
    """
    height, space = options.height, options.color_space
    check_libraries(options)
    env, suffixes = folder / "env", (".exr", ".hdr")
    maps = {named_file(env, name, suffix): name for name in environments for suffix in suffixes}
    mesh, pictures = write_mesh(decomposition.asset, decomposition.similarity, folder / "mesh.glb")
    written = [folder / name for name in ("mesh.glb", *(f"{name}.png" for name in NAMES))]
    for path, photo in maps.items():
        environments[photo].save(path, height, space)
    written += maps
    lamps = [] if light is None else [DirectionalLight.of(source) for source in light.lamps]
    if light is not None:
        image = light.image if height is None else resized_map(light.image, height)
        for name in ("light.exr", "light.hdr"):
            write_map(folder / name, image, space)
        sun = Sun.SEPARATE if light.lamps else Sun.INSIDE
        write_ultra_hdr(folder / "light.jpg", image)
        write_sources(folder / "light.exr", len(image), light.lamps or light.inside, sun, ["light.hdr"])
        environment = ImageBasedLight.of(image)
        write_glb(folder / "scene.glb", mesh, pictures, lights=lamps, environment=environment)
        names = "light.exr", "light.hdr", "light.jpg", "light.light.json", "scene.glb"
        written += [folder / name for name in names]
    if options.materialx:
        written.append(write_materialx(folder))
    if options.usd:
        written += write_usd(folder, mesh, None if light is None else folder / "light.exr", lamps, options)
    return written


def check_libraries(options: ExportOptions) -> None:
    """Raise `ConfigError` naming the extra when a library that the options need is missing."""
    if options.usd:
        check_usd()
    if options.materialx:
        check_materialx()


def write_addon(folder: Path) -> Path:
    """Write the add-on for Blender into `folder`, from where Blender installs it, and return its path."""
    write_bytes(folder / ADDON, (resources.files("lightprobe") / "assets" / "blender" / ADDON).read_bytes())
    return folder / ADDON
