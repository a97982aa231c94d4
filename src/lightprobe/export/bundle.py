"""A decomposition in files other programs read: GLB, textures and environment maps, all in the user's own frame."""

from pathlib import Path

from lightprobe.core.files import named_file
from lightprobe.core.run import RunFolder
from lightprobe.export.glb import write_glb
from lightprobe.export.gltf_mesh import gltf_mesh
from lightprobe.export.pictures import write_pictures
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Similarity


def write_mesh(asset: Asset, similarity: Similarity, glb: Path) -> None:
    """Write the textured mesh as a GLB file with base_color.png, orm.png and normal.png beside it.

    Positions are in the user's frame and units, turned to glTF's y-up axes.
    """
    pictures = write_pictures(asset, glb.parent)
    write_glb(glb, gltf_mesh(asset.mesh, similarity), pictures)


def write_run_outputs(decomposition: Decomposition, run: RunFolder) -> None:
    """Write RUN/mesh and RUN/env: what Phase I leaves for other programs."""
    write_mesh(decomposition.asset, decomposition.similarity, run.mesh_folder / "object.glb")
    for photo, light in decomposition.lights.items():
        light.save(run.environment_file(photo))


def export(decomposition: Decomposition, folder: Path, environments: dict[str, Environment]) -> list[Path]:
    """Write mesh.glb, its textures, and each environment as EXR and HDR under env/; return the files written.

    `environments` maps a photo's name to its light: those of Phase I, predictions, or both.
    """
    maps = {named_file(folder / "env", name, suffix): name for name in environments for suffix in (".exr", ".hdr")}
    write_mesh(decomposition.asset, decomposition.similarity, folder / "mesh.glb")
    for path, photo in maps.items():
        environments[photo].save(path)
    return [*(folder / name for name in ("mesh.glb", "base_color.png", "orm.png", "normal.png")), *maps]
