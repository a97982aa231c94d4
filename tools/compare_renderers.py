"""The object of a run in Blender (Cycles), in three.js and in `lightprobe render`: same camera, same map.

    python tools/compare_renderers.py RUN -o DIR --bpy /path/to/python --three node_modules/three

RUN/mesh/object.glb and a map are given to the two programs as a user would, through the add-on and through
GLTFLoader and EXRLoader; all tone curves are the plain sRGB one. The pictures, and their differences from
ours four times as strong, go to DIR; the mean absolute difference of the sRGB values, in 255ths inside the
mask, is printed as a table and written to DIR/differences.json. `bpy` is Blender as a module (pip install
bpy, into an environment of its own).
"""

import argparse
import json
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import torch

from lightprobe.core.run import RunFolder
from lightprobe.evaluation import relight
from lightprobe.imaging import read_hdr, read_ldr, resize_area, srgb_encode, write_png
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.scene.camera import Camera
from lightprobe.scene.record import read_record
from renderers.browser import three_picture

_GAIN = 4  # of the pictures of differences
_INSIDE = 0.999  # coverage, in all pictures, of the pixels compared


@dataclass(frozen=True)
class Rendered:
    """A picture: straight sRGB colour (H, W, 3) and coverage (H, W), float32 in [0, 1]."""

    color: np.ndarray
    cover: np.ndarray

    @staticmethod
    def of_linear(premultiplied: np.ndarray, cover: np.ndarray) -> "Rendered":
        """Return the picture of linear premultiplied radiance (H, W, 3)."""
        straight = premultiplied / np.maximum(cover, 1e-6)[..., None]
        return Rendered(srgb_encode(np.clip(straight, 0, 1)).astype(np.float32), cover)

    def on_white(self) -> np.ndarray:
        """Return it on white (H, W, 3)."""
        return self.color * self.cover[..., None] + 1 - self.cover[..., None]


def difference(first: Rendered, second: Rendered) -> float:
    """Return the mean absolute difference in 255ths over channels and the pixels that both cover wholly."""
    inside = np.minimum(first.cover, second.cover) > _INSIDE
    return float(255 * np.abs(first.color - second.color)[inside].mean())


def ours(run: Path, environment: Path, camera: Camera, output: Path) -> Rendered:
    """Return what `lightprobe render` shows, and write it."""
    decomposition = Decomposition.load(RunFolder.open(run), torch.device("cpu"))
    image, cover = (t.numpy() for t in relight(decomposition, Environment.load(environment), camera))
    rendered = Rendered.of_linear(image, cover)
    write_png(output, rendered.color, rendered.cover, srgb=False)
    return rendered


def in_blender(python: Path, given: dict[str, Any]) -> Rendered:
    """Return what Cycles shows; `given` is described in `renderers.blender_picture`."""
    script = Path(__file__).parent / "renderers" / "blender_picture.py"
    with resources.as_file(
        resources.files("lightprobe") / "assets" / "blender" / "lightprobe_import.py"
    ) as addon:
        command = [str(python), str(script), json.dumps({"addon": str(addon), **given})]
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"Blender failed: {done.stderr}")
    image = read_hdr(Path(given["output"]))
    return Rendered.of_linear(image[..., :3], image[..., 3])


def in_three(three: Path, mesh: Path, environment: Path, camera: Camera, output: Path) -> Rendered:
    """Return what three.js shows; its samples are averaged in linear light, as ours are."""
    three_picture(three, mesh, environment, camera.to_json(), output)
    color, cover = read_ldr(output)
    assert cover is not None
    small = resize_area(np.dstack([color * cover[..., None], cover]), camera.height, camera.width)
    return Rendered.of_linear(small[..., :3], small[..., 3])


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--bpy", type=Path, help="Python that has bpy; without it Blender is left out")
    parser.add_argument(
        "--three", type=Path, help="folder of the npm package three; without it three.js is left out"
    )
    parser.add_argument("--photo", help="test photo whose camera is taken; by default the first")
    parser.add_argument("--env", type=Path, help="map; by default the light of the first training photo")
    parser.add_argument("--samples", type=int, default=128, help="paths for each of Blender's pixels")
    parser.add_argument("--bounces", type=int, default=4)
    given = parser.parse_args(arguments)
    run = RunFolder.open(given.run)
    cameras = read_record(run).cameras["test"]
    camera = cameras[given.photo or next(iter(cameras))]
    environment = given.env or sorted(run.environment_folder.glob("*.exr"))[0]
    folder, mesh = given.output, run.mesh_folder / "object.glb"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {"lightprobe": ours(given.run, environment, camera, folder / "lightprobe.png")}
    if given.bpy is not None:
        pictures["blender"] = in_blender(
            given.bpy,
            {
                "mesh": str(mesh),
                "map": str(environment),
                "camera": camera.to_json(),
                "samples": given.samples,
                "bounces": given.bounces,
                "output": str(folder / "blender.exr"),
            },
        )
    if given.three is not None:
        pictures["three.js"] = in_three(given.three, mesh, environment, camera, folder / "three.png")
    report(pictures, folder)


def report(pictures: dict[str, Rendered], folder: Path) -> None:
    """Print and write the differences of all pairs, and write one picture with all pictures side by side."""
    names = list(pictures)
    found = {
        f"{a} - {b}": difference(pictures[a], pictures[b])
        for i, a in enumerate(names)
        for b in names[i + 1 :]
    }
    first = pictures[names[0]].on_white()
    rows = [[pictures[name].on_white() for name in names]]
    rows.append([np.clip(_GAIN * np.abs(pictures[name].on_white() - first), 0, 1) for name in names])
    write_png(folder / "sheet.png", np.concatenate([np.concatenate(row, 1) for row in rows]), srgb=False)
    for pair, value in found.items():
        print(f"{pair:<24} {value:6.2f} of 255")
    (folder / "differences.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
