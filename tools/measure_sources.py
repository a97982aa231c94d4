"""Measures how well the key light of a photo is found: its direction and irradiance, and what its uncertainty is worth.

    python tools/measure_sources.py RUN [RUN ...] [--record FILE.json]

For every test photo of each run's scene whose true light has one dominant sun or lamp (`dominant`) the light is
predicted and its sources fitted to the photo. The source that stands nearest to the true one among those with at least
a third of the strongest one's irradiance is compared with it: "key" is simply the strongest. "map" is what the
predicted map says before the fit. Prints a line for each photo and medians; truth is read from the scene's files.
"""

import argparse
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import luma
from lightprobe.light.sources import LightSource, find_sources
from lightprobe.prediction import Predictor
from lightprobe.runs.stages import open_scene
from lightprobe.scene import load_pixels

LAMP = math.radians(22)  # radius up to which a source is a sun or a lamp; beyond it is a window or a bright sky
SHARE, RIVAL = 0.25, 0.5  # a dominant source's least share of the whole flux, and the most that another lamp has of it


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


def measure(run: Path) -> list[Measured]:
    """Return what is found in all test photos of a run whose light has a dominant source."""
    predictor, scene = Predictor.load(run), open_scene(RunFolder.open(run), None)
    found = []
    for photo in scene.test:
        if photo.truth.environment is None:
            continue
        true = dominant(Environment.load(photo.truth.environment, resolution=32))
        if true is None:
            continue
        prediction = predictor.predict(*load_pixels(photo), refuse=False, sources=True)
        before = key(find_sources(prediction.environment))
        after = key(() if prediction.split is None else prediction.split.sources)
        found.append(Measured(
            run.name, photo.name,
            None if before is None else apart(before, true), None if after is None else apart(after, true),
            None if before is None else strength(before) / strength(true),
            None if after is None else strength(after) / strength(true),
            None if after is None else after.uncertainty,
            None if after is None or after.direction_uncertainty is None
            else math.degrees(after.direction_uncertainty),
        ))  # fmt: skip
    return found


def summary(found: list[Measured]) -> dict[str, float]:
    """Return medians over photos; a photo without a source counts as 180 degrees and no irradiance."""
    degrees = [180.0 if one.degrees is None else one.degrees for one in found]
    before = [180.0 if one.map_degrees is None else one.map_degrees for one in found]
    errors = [1.0 if one.ratio is None else abs(one.ratio - 1) for one in found]
    map_errors = [1.0 if one.map_ratio is None else abs(one.map_ratio - 1) for one in found]
    known = [(abs(one.ratio - 1) / max(one.ratio * one.uncertainty, 1e-9)) for one in found
             if one.ratio is not None and one.uncertainty is not None]  # fmt: skip
    turned = [one.degrees / one.direction_uncertainty for one in found
              if one.degrees is not None and one.direction_uncertainty is not None]  # fmt: skip
    return {
        "photos": len(found), "degrees": float(np.median(degrees)), "map_degrees": float(np.median(before)),
        "irradiance_error": float(np.median(errors)), "map_irradiance_error": float(np.median(map_errors)),
        "within_one_deviation": float(np.mean([z <= 1 for z in known])) if known else math.nan,
        "within_two_deviations": float(np.mean([z <= 2 for z in known])) if known else math.nan,
        "direction_within_two_deviations": float(np.mean([z <= 2 for z in turned])) if turned else math.nan,
    }  # fmt: skip


def main() -> None:
    """Measure the runs of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--record", type=Path, help="also write all numbers here, as JSON")
    given = parser.parse_args()
    every = [one for run in given.runs for one in measure(run)]
    for one in every:
        print(json.dumps(vars(one)))
    if every:
        print(json.dumps(summary(every)))
    else:
        print("No test photo's light has one dominant sun or lamp.")
    if given.record is not None and every:
        write_json(given.record, {"photos": [vars(one) for one in every], "summary": summary(every)})


if __name__ == "__main__":
    main()
