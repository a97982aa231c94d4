"""The add-on for Blender among an export's files; it is one file, `assets/blender/lightprobe_import.py`."""

from importlib import resources
from pathlib import Path

from lightprobe.core.files import write_bytes

ADDON = "lightprobe_import.py"


def write_addon(folder: Path) -> Path:
    """Write the add-on into `folder`, from where Blender installs it, and return its path."""
    path = folder / ADDON
    write_bytes(path, (resources.files("lightprobe") / "assets" / "blender" / ADDON).read_bytes())
    return path
