"""A `Decomposition` in, files for other programs out: meshes, textures and maps in the user's frame."""

from lightprobe.export.bundle import SceneLight, export, write_mesh, write_run_outputs
from lightprobe.export.pictures import write_picture

__all__ = ["SceneLight", "export", "write_mesh", "write_picture", "write_run_outputs"]
