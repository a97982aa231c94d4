"""Make the bundled scene of `lightprobe demo`, or of one of the test objects: every photo is under another light.

    python tools/make_demo_scene.py OUT_DIR            # the scene as shipped, some minutes on two cores
    python tools/make_demo_scene.py OUT_DIR --check    # prove conventions and noise of a scene made before

Objects that are nearly black, to see how Phase I finds their brightness; two to four minutes each on two cores:

    python tools/make_demo_scene.py black-metal --object toy-car --samples 160        # metallic paint, .02 to .08
    python tools/make_demo_scene.py black-matte --object camera --samples 160         # plastic and leather, .02 to .05
    python tools/make_demo_scene.py dark-and-bright --object lantern --samples 160    # gloss .03 beside porcelain .6

One whose masks do not show that it is open:

    python tools/make_demo_scene.py open --object mug --samples 160

One without any texture, to see how well new photos of it are located:

    python tools/make_demo_scene.py smooth --object pebble --samples 160

Needs the development extra `mitsuba` and an LLVM shared library, newer than 15 (Debian: `apt install libllvm19`).
Nothing is downloaded: geometry, textures and training lights are computed, the lights of the test photos are the three
CC0 environments in `demo_scene/hdri`. The same options make the same scene.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from demo_scene.models import Subject
from lightprobe.core.files import atomic_folder


def main() -> None:
    """Read the command line, make or check the scene."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="OUT_DIR")
    parser.add_argument("--check", action="store_true", help="check an existing scene instead of making one")
    parser.add_argument("--object", choices=[subject.value for subject in Subject], help="what to photograph")
    for name, kind in (("seed", int), ("side", int), ("samples", int), ("train", int), ("test", int)):
        parser.add_argument(f"--{name}", type=kind, help="instead of the shipped scene's value")
    options = parser.parse_args()
    if options.check:
        from demo_scene.check import report

        print(report(options.folder))
        return
    if options.folder.exists() and not (options.folder / "generation.json").exists():
        parser.error(f"{options.folder} exists and is not a scene made by this command; name a new folder.")
    from demo_scene.dataset import Settings, write_scene  # starts Mitsuba, so only when it is needed

    names = ("seed", "side", "samples", "train", "test")
    settings = Settings(**{name: value for name in names if (value := getattr(options, name)) is not None})
    if options.object is not None:
        settings = replace(settings, object=Subject(options.object))
    with atomic_folder(options.folder) as temporary:
        write_scene(temporary, settings)


if __name__ == "__main__":
    main()
