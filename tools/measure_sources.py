"""Measures how well the key light of a photo is found: its direction and irradiance, and what its uncertainty
is worth.

    python tools/measure_sources.py RUN [RUN ...] [--lights FOLDER ...] [--record FILE.json]

For every test photo of each run's scene whose true light has one dominant sun or lamp (`dominant`) the light
is predicted and its sources fitted to the photo. "key" is the strongest source, "map" what the predicted map
alone says. With --lights, the photos are instead renders of the scene's true object (`evaluation.oracle`)
under each dominant light of the folders' maps, from the test cameras in turn, 256 pixels wide, exposed for
the object and clipped at white: the run's own errors stay. Prints a line for each photo, and medians. Truth
is read from the scene's files.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.errors import LightprobeError
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.evaluation.oracle import true_asset
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.files import environment_files
from lightprobe.light.photometry import luma
from lightprobe.light.sources import LightSource, find_sources
from lightprobe.prediction import Predictor
from lightprobe.render.picture import Picture
from lightprobe.runs.phases import open_scene
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels, Scene

LAMP = math.radians(
    22
)  # radius up to which a source is a sun or a lamp; beyond it is a window or a bright sky
RESOLUTION = 32  # of the lights that sources are looked for in
WIDTH, EXPOSED = (
    256,
    0.5,
)  # of renders: pixels, and the linear value that four fifths of the object stay under
SHARE, RIVAL = (
    0.25,
    0.5,
)  # a dominant source's least share of the whole flux, and the most that another lamp has of it


@dataclass(frozen=True)
class Measured:
    """One photo's key light against the true one."""

    run: str
    photo: str
    map_degrees: float | None  # None: the map has no source
    degrees: float | None
    map_ratio: float | None  # irradiance over the true one, by luma
    ratio: float | None
    uncertainty: float | None
    direction_uncertainty: float | None


def strength(source: LightSource) -> float:
    """Return the luma of a source's irradiance."""
    return float(luma(torch.tensor(source.irradiance)))


def dominant(light: Environment) -> LightSource | None:
    """Return a light's dominant sun or lamp, or None where it has none: much of the flux, and no rival."""
    lamps = [source for source in find_sources(light) if source.angular_radius <= LAMP]
    lamps.sort(key=strength, reverse=True)
    flux = 4 * math.pi * float(luma(light.mean()))
    if not lamps or strength(lamps[0]) < SHARE * flux:
        return None
    rivals = lamps[1:2]
    return None if rivals and strength(rivals[0]) > RIVAL * strength(lamps[0]) else lamps[0]


def apart(a: LightSource, b: LightSource) -> float:
    """Return the angle between two sources in degrees."""
    cosine = sum(x * y for x, y in zip(a.direction, b.direction, strict=True))
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def key(sources: tuple[LightSource, ...]) -> LightSource | None:
    """Return the strongest source."""
    return max(sources, key=strength, default=None)


Shots = Iterator[tuple[str, Pixels, Camera, LightSource]]  # name, photo, its camera, its true key light


def own_shots(scene: Scene) -> Shots:
    """Yield the test photos of a scene whose light has a dominant source."""
    for photo in scene.test:
        if photo.truth.environment is not None:
            true = dominant(Environment.load(photo.truth.environment, resolution=RESOLUTION))
            if true is not None:
                yield photo.name, *load_pixels(photo), true


def rendered_shots(scene: Scene, folders: list[Path]) -> Shots:
    """Yield renders of the scene's true object under the dominant lights of some folders."""
    asset, views, turn = true_asset(scene), scene.test, 0
    for path in (path for folder in folders for path in environment_files(folder)):
        light = Environment.load(path, resolution=2 * RESOLUTION)
        true = dominant(light.resized(RESOLUTION))
        if true is None:
            continue
        camera = views[turn % len(views)].camera
        turn += 1
        camera = camera.resized(WIDTH, round(WIDTH * camera.height / camera.width))
        picture = Picture.of(
            asset,
            camera.normalised(scene.similarity),
            prefilter.cached(light.resolution, light.device),
            light.device,
        )
        image, cover = picture.render(light.texels)
        exposure = EXPOSED / float(image[cover > 0.99].mean(-1).quantile(0.8))
        color = (exposure * image / cover.clamp(min=1e-6)[..., None]).clamp(0, 1) * (cover > 0)[..., None]
        pixels = Pixels.of(color.numpy(), cover.numpy())
        yield path.stem, pixels, camera, true.scaled(torch.full((3,), exposure))


def measure(run: Path, folders: list[Path]) -> list[Measured]:
    """Return what is found in a run's test photos, or in renders under the maps of `folders` where there are
    some.
    """
    predictor, scene = Predictor.load(run), open_scene(RunFolder.open(run), None)
    shots = rendered_shots(scene, folders) if folders else own_shots(scene)
    return [measured(predictor, run.name, *shot) for shot in shots]


def measured(
    predictor: Predictor, run: str, name: str, pixels: Pixels, camera: Camera, true: LightSource
) -> Measured:
    """Return one photo's key light against the true one."""
    prediction = predictor.predict(pixels, camera, refuse=False, sources=True)
    before = key(find_sources(prediction.environment))
    after = key(() if prediction.split is None else prediction.split.sources)
    turn = None if after is None else after.direction_uncertainty
    return Measured(
        run,
        name,
        None if before is None else apart(before, true),
        None if after is None else apart(after, true),
        None if before is None else strength(before) / strength(true),
        None if after is None else strength(after) / strength(true),
        None if after is None else after.uncertainty,
        None if turn is None else math.degrees(turn),
    )


def summary(found: list[Measured]) -> dict[str, float]:
    """Return medians over photos; a photo without a source counts as 180 degrees and no irradiance."""
    degrees = [180.0 if one.degrees is None else one.degrees for one in found]
    before = [180.0 if one.map_degrees is None else one.map_degrees for one in found]
    errors = [1.0 if one.ratio is None else abs(one.ratio - 1) for one in found]
    map_errors = [1.0 if one.map_ratio is None else abs(one.map_ratio - 1) for one in found]
    known = [
        (abs(one.ratio - 1) / max(one.ratio * one.uncertainty, 1e-9))
        for one in found
        if one.ratio is not None and one.uncertainty is not None
    ]
    turned = [
        one.degrees / one.direction_uncertainty
        for one in found
        if one.degrees is not None and one.direction_uncertainty is not None
    ]
    return {
        "photos": len(found),
        "degrees": float(np.median(degrees)),
        "map_degrees": float(np.median(before)),
        "irradiance_error": float(np.median(errors)),
        "map_irradiance_error": float(np.median(map_errors)),
        "within_one_deviation": float(np.mean([z <= 1 for z in known])) if known else math.nan,
        "within_two_deviations": float(np.mean([z <= 2 for z in known])) if known else math.nan,
        "direction_within_two_deviations": float(np.mean([z <= 2 for z in turned])) if turned else math.nan,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the runs of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument(
        "--lights", nargs="+", type=Path, default=[], help="folders of maps to render photos under"
    )
    parser.add_argument("--record", type=Path, help="also write all numbers here, as JSON")
    given = parser.parse_args(arguments)
    try:
        every = [one for run in given.runs for one in measure(run, given.lights)]
    except LightprobeError as error:
        sys.exit(str(error))
    if not every:
        sys.exit("No photo's light has one dominant sun or lamp.")
    for one in every:
        print(json.dumps(vars(one)))
    print(json.dumps(summary(every)))
    if given.record is not None:
        write_json(given.record, {"photos": [vars(one) for one in every], "summary": summary(every)})


if __name__ == "__main__":
    main()
