"""Peak memory of the commands whose memory a photo's size decides: the table of docs/limits.md.

    python -m benchmarks memory RUN [--megapixels 12 48 134] [--kinds jpg png] [--commands predict locate ...]

RUN is a trained run of the bundled scene (`lightprobe demo -o RUN`); it is copied and stays as it is. The photo is one
of the scene's test photos in front of its light, enlarged. Every command runs in a process of its own, one after the
other, and its largest resident set is counted, in GiB. `read` decodes the photo and does nothing else; `inspect`, `fit`
and `prepare` get two such photos among smaller ones of the same scene. What a command said is printed as it ends; a
cell in brackets is of one that was refused or failed.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
from PIL import Image

# Runs a command from a small process, so that what this one has held is not counted as the command's
_LAUNCHER = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
sys.stderr.buffer.write(done.stdout)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024))
sys.exit(done.returncode)
"""
_READ = """
import sys
from pathlib import Path
from lightprobe.imaging import PhotoFile
photo = PhotoFile(Path(sys.argv[1]))
for strip in photo.strips():
    photo.rows(*strip)
"""
_LOADING = """
import sys
from pathlib import Path
import torch
from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction.photos import load_targets
from lightprobe.scene import load_scene
scene = load_scene(Path(sys.argv[1]))
load_targets(scene, scene.train, DecomposeConfig().pass3_side, torch.device("cpu"))
"""
_EVALUATION = """
import sys
from pathlib import Path
from lightprobe.evaluation import evaluate
from lightprobe.models import Decomposition
from lightprobe.prediction import Method
from lightprobe.core.run import RunFolder
from lightprobe.scene import load_scene
import dataclasses, torch
found = Decomposition.load(RunFolder.open(Path(sys.argv[1])), torch.device("cpu"))
loaded = load_scene(Path(sys.argv[2]))
photos = tuple(photo for photo in loaded.train + loaded.test if photo.name == "a")
scene = dataclasses.replace(loaded, similarity=found.similarity, test=photos)
evaluate(found, None, scene, methods=[Method.CONSTANT])
"""


@dataclass(frozen=True)
class Shot:
    """One photo as a file, and what belongs to it."""

    photo: Path
    camera: Path
    mask: Path
    light: Path
    scene: Path  # the photo twice and others of the scene, small, with cameras and masks
    run: Path


def cli(*words: object) -> list[str]:
    """Return the command line of a lightprobe command in a process of its own."""
    return [sys.executable, "-m", "lightprobe", *map(str, words)]


def _python(code: str, *words: object) -> list[str]:
    return [sys.executable, "-c", code, *map(str, words)]


COMMANDS: dict[str, Callable[[Shot], list[str]]] = {
    "read": lambda s: _python(_READ, s.photo),
    "predict --camera": lambda s: cli("predict", s.run, s.photo, "--camera", s.camera, "--mask", s.mask),
    "predict": lambda s: cli("predict", s.run, s.photo),
    "locate": lambda s: cli("locate", s.run, s.photo),
    "insert": lambda s: [
        *cli("insert", s.run, s.photo, "--camera", s.camera, "--mask", s.mask),
        *("--object", str(s.run / "mesh" / "object.glb"), "-o", str(s.scene.parent / "inserted.png")),
    ],
    "calibrate": lambda s: [
        *cli("calibrate", s.run, "--photo", s.photo, "--camera", s.camera, "--mask", s.mask),
        *("--env", str(s.light)),
    ],
    "inspect": lambda s: cli("inspect", s.scene),
    "fit (reading)": lambda s: _python(_LOADING, s.scene),
    "eval": lambda s: _python(_EVALUATION, s.run, s.scene),
    "prepare": lambda s: cli("prepare", s.scene / "images", "-o", s.scene.parent / "prepared"),
}


def peak(command: Sequence[str]) -> tuple[float, int, str]:
    """Return the largest resident set of a command in GiB, its exit code, and what it said."""
    done = subprocess.run(
        [sys.executable, "-c", _LAUNCHER, *command], capture_output=True, text=True, check=False
    )
    return int(done.stdout.split()[-1]) / 2**30, done.returncode, done.stderr


def make_shot(run: Path, megapixels: float, kind: str, folder: Path) -> Shot:
    """Write the photo, its camera, mask and light, and a scene of it into `folder`, in a process that ends."""
    words = [str(run), "--make", str(megapixels), kind, str(folder)]
    subprocess.run([sys.executable, "-m", "benchmarks", "memory", *words], check=True)
    names = (f"photo.{kind}", "camera.json", "mask.png", "light.exr", "scene")
    return Shot(*(folder / name for name in names), run)


def write_shot(megapixels: float, kind: str, folder: Path) -> None:
    """Write what `make_shot` returns."""
    from benchmarks.composed import composed
    from lightprobe.core.files import write_json
    from lightprobe.imaging import srgb_encode
    from lightprobe.scene import load_scene
    from lightprobe.scene.pixels import load_alpha

    Image.MAX_IMAGE_PIXELS = None
    with resources.as_file(resources.files("lightprobe") / "assets" / "demo") as demo:
        photos = load_scene(demo).test
        shown = [as_picture(srgb_encode(composed(one).clip(0, 1))) for one in photos]
        covers = [as_picture(load_alpha(one)) for one in photos]
        shutil.copyfile(str(photos[0].truth.environment), folder / "light.exr")
    side = round((megapixels * 1e6) ** 0.5)
    write_photo(shown[0].resize((side, side), Image.Resampling.BICUBIC), folder / f"photo.{kind}")
    covers[0].resize((side, side)).save(folder / "mask.png", compress_level=1)
    large = photos[0].camera.resized(side, side)
    write_json(folder / "camera.json", large.to_json())
    images, masks = (folder / "scene" / name for name in ("images", "masks"))
    images.mkdir(parents=True)
    masks.mkdir()
    cameras = {}
    for name in ("a", "b"):  # links: one file's room on the disk
        (images / f"{name}.{kind}").hardlink_to(folder / f"photo.{kind}")
        (masks / f"{name}.png").hardlink_to(folder / "mask.png")
        cameras[f"{name}.{kind}"] = large
    for photo, picture, cover in zip(photos[1:], shown[1:], covers[1:], strict=True):
        picture.save(images / f"{photo.name}.png")
        cover.save(masks / f"{photo.name}.png")
        cameras[f"{photo.name}.png"] = photo.camera
    frames = []
    for name, camera in cameras.items():
        lens = {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
        files = {"file_path": f"images/{name}", "mask_path": f"masks/{Path(name).stem}.png"}
        pose = {"w": camera.width, "h": camera.height, "transform_matrix": camera.camera_to_world.tolist()}
        frames.append({**files, **lens, **pose})
    write_json(folder / "scene" / "transforms.json", {"camera_model": "PINHOLE", "frames": frames})


def as_picture(values: np.ndarray) -> Image.Image:
    """Return values (h, w) or (h, w, 3) in [0, 1] as a picture of 8 bits."""
    return Image.fromarray((values * 255 + 0.5).astype(np.uint8))


def write_photo(picture: Image.Image, path: Path) -> None:
    """Write a picture as a file of the kind that its name says."""
    if path.suffix in (".jpg", ".png", ".webp", ".avif"):
        picture.save(path, compress_level=1, quality=90)
    elif path.suffix == ".heic":
        import pillow_heif

        pillow_heif.register_heif_opener()
        picture.save(path, quality=80)
    elif path.suffix == ".tif":
        import tifffile

        tifffile.imwrite(path, np.asarray(picture).astype(np.uint16) * 257, photometric="rgb")
    else:
        from lightprobe.imaging import write_exr

        write_exr(path, np.asarray(picture, np.float32) / 255, half=True)


def main(words: Sequence[str]) -> None:
    """Read the command line, measure and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("--megapixels", type=float, nargs="+", default=[12, 48, 134])
    kinds, every = ["jpg", "png"], list(COMMANDS)
    parser.add_argument(
        "--kinds", nargs="+", default=kinds, metavar="KIND", help="also exr tif heic webp avif"
    )
    parser.add_argument("--commands", nargs="+", default=every, choices=every, metavar="COMMAND")
    parser.add_argument("--make", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args(words)
    if given.make is not None:
        write_shot(float(given.make[0]), given.make[1], Path(given.make[2]))
        return
    columns = [(size, kind) for size in given.megapixels for kind in given.kinds]
    cells: dict[str, list[str]] = {command: [] for command in given.commands}
    for size, kind in columns:
        with tempfile.TemporaryDirectory() as name:
            run = shutil.copytree(given.run, Path(name) / "run")
            shot = make_shot(run, size, kind, Path(name))
            for command, row in cells.items():
                row.append(measured(command, shot))
    print(f"\n| command | {' | '.join(f'{size:g} MP {kind}' for size, kind in columns)} |")
    print(f"| --- |{' ---: |' * len(columns)}")
    for command, row in cells.items():
        print(f"| {command} | {' | '.join(row)} |")


def measured(command: str, shot: Shot) -> str:
    """Return the cell of one command and photo; what the command said is printed."""
    memory, code, said = peak(COMMANDS[command](shot))
    print(command, shot.photo.suffix, f"{memory:.2f} GiB, exit {code}: {said.strip()[-400:]}", flush=True)
    return f"{memory:.2f}" if code == 0 else f"({memory:.2f})"
