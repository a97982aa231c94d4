"""What a photo's background, and further photos of the same light, add to a prediction.

    python tools/measure_evidence.py --data DATA --runs RUNS --scenes spot chair

DATA holds synthetic scene folders, RUNS a trained run of the same name for each; both are only read. Tables:

    background   test photos over their own true environment (`composed_photos`), with the true camera and mask: maps
                 that use what is seen around the object, beside maps that do not
    together     photos of the relight split, four views of each light: one map from all four, with exposures found
                 with the light, beside the maps from each

Scores are those of the evaluation: log-RMSE over all directions, the three spheres, and the object in other views
relit with the map against the true light, in dB raw and after one factor per channel.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from composed_photos import composed
from lightprobe.evaluation.true_light import StandIn
from lightprobe.evaluation.true_light import TrueLight
from lightprobe.imaging import CLIPPED, srgb_decode, srgb_encode
from lightprobe.prediction import Prediction, Predictor
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.background import Background
from lightprobe.scene.photo import Photo, Scene

NAMES = (
    "diffuse_si_rmse",
    "matte_si_rmse",
    "mirror_si_rmse",
    "relit_psnr",
    "relit_psnr_scaled",
    "light_log_rmse",
)
HEAD = (
    "| scene | photos | spheres | relit, raw / scaled | log-RMSE | ratio | worse |\n"
    "| --- | ---: | --- | --- | --- | --- | ---: |"
)
CPU = torch.device("cpu")


def photos_of_one_light(scene: Scene) -> list[list[Photo]]:
    """Return the photos of the relight split, those of each light together."""
    lights = dict.fromkeys(photo.truth.environment for photo in scene.relight)
    return [[photo for photo in scene.relight if photo.truth.environment == light] for light in lights]


@dataclass(frozen=True)
class Subject:
    """A scene with its run."""

    scene: Scene
    predictor: Predictor
    stand_in: StandIn

    @staticmethod
    def of(scene: Scene, run: Path) -> "Subject":
        """Load the run of a scene."""
        predictor = Predictor.load(run)
        return Subject(scene, predictor, StandIn.of(predictor.decomposition, scene, CPU))

    def scores(self, prediction: Prediction, photo: Photo) -> np.ndarray:
        """Return the scores of `NAMES` of a map against the true light of a photo."""
        if photo.truth.environment is None:
            raise ValueError(f"The light of {photo.name} is not known.")
        center, resolution = self.predictor.decomposition.similarity.center, prediction.environment.resolution
        true = TrueLight.load(photo.truth.environment, photo.camera, center, resolution, CPU)
        relit = self.stand_in.scores(photo.name, prediction.environment, true.environment)
        found = true.scores(prediction) | relit
        return np.array([found[name] for name in NAMES])

    def background(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the scores (N, 6) of the test photos without and with their background, clipped as in a PNG."""
        without: list[np.ndarray] = []
        using: list[np.ndarray] = []
        for photo in self.scene.test:
            pixels, camera = load_pixels(photo)
            shown = srgb_decode(
                np.rint(255 * srgb_encode(composed(photo).clip(0, 1))) / 255
            )  # as coarse as 8 bits
            behind = Background.of(shown.astype(np.float32), shown >= CLIPPED, pixels.alpha, camera)
            for background, rows in ((None, without), (behind, using)):
                prediction = self.predictor.predict(pixels, camera, background=background, refuse=False)
                rows.append(self.scores(prediction, photo))
        return np.array(without), np.array(using)

    def together(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the scores (N, 6) of the photos of the relight split, each singly and with those of its
        light.
        """
        singly, jointly = [], []
        for photos in photos_of_one_light(self.scene):
            views = [load_pixels(photo) for photo in photos]
            joint, _ = self.predictor.predict_together(views, refuse=False)
            for photo, view in zip(photos, views, strict=True):
                singly.append(self.scores(self.predictor.predict(*view, refuse=False), photo))
                jointly.append(self.scores(joint, photo))
        return np.array(singly), np.array(jointly)


def row(name: str, before: np.ndarray, after: np.ndarray) -> str:
    """Return a row of a table: means before and after, the ratio of log-RMSE and spheres, and where it became
    worse.
    """
    a, b = before.mean(0), after.mean(0)
    spheres = " → ".join("/".join(f"{value:.3f}" for value in part[:3]) for part in (a, b))
    relit = " → ".join(f"{part[3]:.1f} / {part[4]:.1f}" for part in (a, b))
    ratio = f"{b[5] / a[5]:.3f}; spheres " + "/".join(f"{value:.2f}" for value in b[:3] / a[:3])
    worse = int((after[:, 5] > 1.0001 * before[:, 5]).sum())
    return f"| {name} | {len(before)} | {spheres} | {relit} | {a[5]:.3f} → {b[5]:.3f} | {ratio} | {worse} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--scenes", nargs="+", required=True)
    parser.add_argument(
        "--tables", nargs="+", choices=("background", "together"), default=["background", "together"]
    )
    given = parser.parse_args(arguments)
    for table in given.tables:
        print(f"\n{table}\n\n{HEAD}", flush=True)
        gathered: list[tuple[np.ndarray, np.ndarray]] = []
        for name in given.scenes:
            subject = Subject.of(load_scene(given.data / name), given.runs / name)
            gathered.append(getattr(subject, table)())
            print(row(name, *gathered[-1]), flush=True)
        before, after = (np.concatenate(part) for part in zip(*gathered, strict=True))
        print(row("all photos", before, after), flush=True)


if __name__ == "__main__":
    main()
