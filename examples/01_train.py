"""Train both phases from Python, with settings of your own, into a run folder.

    python examples/01_train.py src/lightprobe/assets/demo runs/pot --draft

Settings are frozen dataclasses: take a preset and replace what should differ. The same call goes on where an
interrupted one stopped, and a finished run is only loaded. `--draft` is far too short for good results, but
done in a minute or two.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import lightprobe
from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset, settings


def draft() -> tuple[DecomposeConfig, DistillConfig]:
    """Return settings that only show that everything works."""
    quick = settings(Preset.QUICK)
    first = replace(
        quick.decompose,
        pass1_iterations=60,
        pass2_iterations=30,
        pass3_iterations=30,
        pass1_side=64,
        pass2_side=96,
        pass3_side=160,
        lattice_cells=32,
        hull_voxels=48,
        texture_size=128,
        pass3_texture_size=128,
        trial_steps=5,
    )
    return first, replace(quick.distill, steps=60, sphere_steps=30, synthetic_lessons=16, samples=256)


def main() -> None:
    """Train as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path, help="folder with photos and cameras")
    parser.add_argument("run", type=Path, help="run folder to make or to go on with")
    parser.add_argument("--preset", choices=[preset.value for preset in Preset], default="quick")
    parser.add_argument("--draft", action="store_true", help="a few steps only")
    given = parser.parse_args()

    first, second = draft() if given.draft else (None, None)  # None: the preset's
    run = lightprobe.train(
        given.scene, given.run, preset=Preset(given.preset), decompose=first, distill=second
    )
    decomposition = lightprobe.Predictor.load(run.path).decomposition
    print(
        f"{len(decomposition.asset.mesh.faces)} triangles, the lights of {len(decomposition.lights)} photos"
    )
    print(f"mesh: {run.mesh_folder / 'object.glb'}")


if __name__ == "__main__":
    main()
