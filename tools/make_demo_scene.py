"""Make the bundled scene of `lightprobe demo`: a coffee pot, every photo of which is under another light.

    python tools/make_demo_scene.py OUT_DIR            # the scene as shipped, some minutes on two cores

Needs the development extra `mitsuba` and an LLVM shared library, newer than 15 (Debian: `apt install libllvm19`).
Nothing is downloaded: geometry, textures and training lights are computed, the lights of the test photos are the three
CC0 environments in `demo_scene/hdri`. The same options make the same scene.
"""

import argparse
import shutil
from pathlib import Path

from lightprobe.core.files import atomic_folder


def main() -> None:
    """Read the command line and make the scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="OUT_DIR")
    for name in ("seed", "side", "samples", "train", "test"):
        parser.add_argument(
            f"--{name}", type=int, default=argparse.SUPPRESS, help="not the shipped scene's value"
        )
    options = vars(parser.parse_args())
    folder = options.pop("folder")
    if folder.exists() and not (folder / "generation.json").exists():
        parser.error(f"{folder} exists and is not a scene made by this command; name a new folder.")
    from demo_scene.dataset import Settings, write_scene  # starts Mitsuba, so only when it is needed
    from demo_scene.textures import make_model

    settings = Settings(**options)
    with atomic_folder(folder) as temporary:
        write_scene(temporary, settings, "coffee-pot", make_model(settings.seed))
        shutil.copyfile(Path(__file__).parent / "demo_scene" / "scene_readme.md", temporary / "README.md")


if __name__ == "__main__":
    main()
