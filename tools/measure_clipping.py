"""How many reduced pixels of the object hold a clipped source pixel, and how many are marked so.

    python tools/measure_clipping.py SCENE...           # at the sizes of the three passes of preset quick
    python tools/measure_clipping.py SCENE... --lights  # and what the marks bring to solved lights

A row for each scene and size: of the pixels that lie wholly inside the mask, the share in which some channel
of some source pixel is clipped, counted one by one; the share that Phase I takes for clipped; and, for
comparison, the share whose average is as bright as a clipped pixel. All in percent, over all training photos.

With --lights, of scenes that bring their object and the lights of their test photos: lights solved for the
true object from test photos at the first pass's size, as a training solves those that it keeps, once with the
pixels that are marked and once with those whose average is as bright as a clipped pixel. Error of ln radiance
over the brightest percent of the sphere, raw and after the whole map's one factor, and over all of it after
that factor.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.config.reconstruction import DecomposeConfig, quick
from lightprobe.core.errors import LightprobeError
from lightprobe.evaluation.metrics import aligned, brightest, environment_log_rmse, log_difference
from lightprobe.evaluation.oracle import true_asset
from lightprobe.light.environment import Environment
from lightprobe.reconstruction.photos import Target, load_targets
from lightprobe.reconstruction.validation import fit_light
from lightprobe.render.asset import Asset
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.photo import CLIPPED, Photo, Scene

_INSIDE = 0.99  # coverage from which a pixel lies wholly inside the mask
_CPU = torch.device("cpu")


def counted(clipped: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return which of height x width pixels overlap a True of `clipped` (H, W), (height, width) bool."""
    found = np.zeros((height, width), bool)
    rows, columns = (
        size * np.arange(count + 1) / count for size, count in zip(clipped.shape, found.shape, strict=True)
    )
    for i in range(height):
        band = np.asarray(clipped[int(rows[i]) : int(np.ceil(rows[i + 1] - 1e-9))].any(0))
        for j in range(width):
            found[i, j] = band[int(columns[j]) : int(np.ceil(columns[j + 1] - 1e-9))].any()
    return found


def shares(scene: Scene, photo: Photo, side: int) -> np.ndarray:
    """Return the numbers (4,) of pixels inside the mask, truly clipped, marked as clipped, and of a clipped
    average.
    """
    (target,) = load_targets(scene, [photo], side, _CPU)
    height, width = target.view.height, target.view.width
    inside = (target.alpha > _INSIDE).numpy()
    whole = load_pixels(photo)[0]
    source = (whole.color >= CLIPPED).any(-1) & (whole.alpha > 0)
    true = counted(source, height, width).ravel()
    average = _clipped_average(target).any(1).numpy()
    marked = target.clipped.any(1).numpy()
    return np.array([inside.sum(), *((part & inside).sum() for part in (true, marked, average))])


def _clipped_average(target: Target) -> torch.Tensor:
    """Return (N, 3) bool: where a reduced photo's colour is as bright as a clipped pixel's."""
    return target.color >= CLIPPED * target.alpha[:, None]


def light_errors(asset: Asset, target: Target, path: Path, config: DecomposeConfig) -> list[float]:
    """Return the errors of the light solved for a photo against the true one, an environment file, as listed
    above.
    """
    light = fit_light(asset, target, config.teacher_resolution, config, seed=0)[1]
    true = Environment.load(path, _CPU, config.teacher_resolution).texels
    difference, bright = log_difference(light, true), brightest(true)
    scaled = aligned(difference)
    return [
        environment_log_rmse(difference, bright),
        environment_log_rmse(scaled, bright),
        environment_log_rmse(scaled),
    ]


def light_rows(scene: Scene, config: DecomposeConfig) -> list[str]:
    """Return the table's rows of a scene's lights; raise `InputError` where it does not bring its object."""
    asset, marked, average = true_asset(scene), list[list[float]](), list[list[float]]()
    for photo in scene.test:
        if photo.truth.environment is not None:
            (target,) = load_targets(scene, [photo], config.pass1_side, _CPU)
            marked.append(light_errors(asset, target, photo.truth.environment, config))
            by_average = replace(target, clipped=_clipped_average(target))
            average.append(light_errors(asset, by_average, photo.truth.environment, config))
    return [
        f"| {scene.root.name} | {name} | "
        + " | ".join(f"{value:.3f}" for value in np.mean(errors, axis=0))
        + " |"
        for name, errors in (("clipped average", average), ("marked", marked))
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--lights", action="store_true", help="measure lights solved from test photos, too")
    given = parser.parse_args(arguments)
    config = quick()
    print("| scene | side | true, % | marked, % | clipped average, % |\n| --- | ---: | ---: | ---: | ---: |")
    try:
        for path in given.scenes:
            scene = load_scene(path)
            for side in (config.pass1_side, config.pass2_side, config.pass3_side):
                inside, *found = np.sum([shares(scene, photo, side) for photo in scene.train], axis=0)
                print(
                    f"| {path.name} | {side} | {' | '.join(f'{100 * n / inside:.2f}' for n in found)} |",
                    flush=True,
                )
        if given.lights:
            print(
                "\n| lights of | by | brightest, raw | scaled | log-RMSE, scaled |\n| --- | --- | ---: | ---: | ---: |"
            )
            for path in given.scenes:
                print("\n".join(light_rows(load_scene(path), config)), flush=True)
    except LightprobeError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
