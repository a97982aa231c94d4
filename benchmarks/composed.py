"""Photos of a synthetic scene's object in front of the environment that lights it, as a camera would have
taken them.

    python tools/composed_photos.py SCENE FOLDER
    python tools/composed_photos.py SCENE FOLDER --train

The scene's test photos have no background. Here each is laid over its own true environment, infinitely far
away, in linear light, and written as an opaque PNG of the same name: FOLDER/r_NNN.png. Photos without a true
environment are left out. With --train FOLDER becomes a copy of the scene instead, whose training photos are
opaque so, with their masks in FOLDER/masks.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from lightprobe.imaging import read_hdr, read_ldr, write_mask, write_png
from lightprobe.light import equirect
from lightprobe.render.surface import View
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo


def background(environment: np.ndarray, camera: Camera) -> np.ndarray:
    """Return what `camera` sees of an equirectangular `environment` (h, 2h, 3), linear, as (H, W, 3) float32."""
    view = View.of(camera, torch.device("cpu"))
    rays = view.rays(torch.arange(camera.height * camera.width))
    map = torch.from_numpy(np.ascontiguousarray(environment[..., :3], np.float32))
    seen = equirect.sample(map, torch.nn.functional.normalize(rays, dim=1))
    return seen.reshape(camera.height, camera.width, 3).numpy()


def composed(photo: Photo) -> np.ndarray:
    """Return a synthetic photo over its true environment, linear (H, W, 3), unclipped."""
    if photo.truth.environment is None:
        raise ValueError(f"The light of {photo.name} is not known.")
    color, alpha = read_ldr(photo.image_path)
    if alpha is None:
        raise ValueError(f"{photo.name} has no alpha channel.")
    behind = background(read_hdr(photo.truth.environment), photo.camera)
    return color * alpha[..., None] + behind * (1 - alpha[..., None])


def write_composed(photos: Sequence[Photo], folder: Path) -> list[Path]:
    """Write the composed photos as sRGB PNG into `folder` and return their files."""
    files = []
    for photo in photos:
        if photo.truth.environment is not None:
            files.append(folder / f"{photo.name}.png")
            write_png(files[-1], composed(photo))
    return files


def write_opaque_scene(scene: Path, folder: Path) -> list[Path]:
    """Copy a synthetic scene to a new `folder`, make its training photos opaque, and return these photos'
    files.
    """
    shutil.copytree(scene, folder)
    files = []
    for photo in load_scene(folder).train:
        alpha = read_ldr(photo.image_path)[1]
        picture = composed(photo)  # which refuses a photo without an alpha channel
        assert alpha is not None
        write_mask(folder / "masks" / photo.image_path.relative_to(folder), alpha)
        write_png(photo.image_path, picture)
        files.append(photo.image_path)
    return files


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and write the photos."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scene", type=Path, metavar="SCENE")
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--train", action="store_true", help="copy the scene, its training photos opaque")
    given = parser.parse_args(arguments)
    if given.train:
        print(
            f"{len(write_opaque_scene(given.scene, given.folder))} opaque training photos in {given.folder}"
        )
        return
    print(f"{len(write_composed(load_scene(given.scene).test, given.folder))} photos in {given.folder}")


if __name__ == "__main__":
    main()
