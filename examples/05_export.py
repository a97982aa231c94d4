"""Mesh and predicted light as files for Blender and three.js.

    python examples/05_export.py runs/pot src/lightprobe/assets/demo/test/r_000.png -o pot

Blender: import pot/mesh.glb, then World > Color > Environment Texture with the .exr. three.js: GLTFLoader for
mesh.glb, EXRLoader for the .exr with EquirectangularReflectionMapping as scene.environment. Neither needs a
rotation.
"""

import argparse
from pathlib import Path

import lightprobe
from lightprobe.export import export
from lightprobe.runs.outputs import write_picture


def main() -> None:
    """Export as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("photos", type=Path, nargs="+", help="photos of the run's scene, or of --camera's")
    parser.add_argument("--camera", type=Path, help="by default those of the run's scene")
    parser.add_argument("-o", "--output", type=Path, default=Path("exported"), help="folder for the files")
    given = parser.parse_args()

    if len({photo.stem for photo in given.photos}) < len(given.photos):
        parser.error(
            "two photos have one name, and so would their lights; give them one by one, with another -o"
        )

    predictor = lightprobe.Predictor.load(given.run)
    lights, views = {}, {}
    for photo in given.photos:
        pixels, camera = lightprobe.load_photo(photo, given.camera or given.run / "scene.json")
        lights[photo.stem] = predictor.predict(pixels, camera).environment
        views[photo.stem] = camera
    given.output.mkdir(parents=True, exist_ok=True)
    for path in export(predictor.decomposition, given.output, lights):
        print(path)

    for name, light in lights.items():  # what the other program should show, if it has the photo's camera
        picture = given.output / f"{name}.png"
        write_picture(picture, *lightprobe.relight(predictor.decomposition, light, views[name]))
        print(picture)


if __name__ == "__main__":
    main()
