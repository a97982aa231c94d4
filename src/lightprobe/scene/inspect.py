"""A look at a scene before an hour is spent on it: every problem at once, and what the hull says."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lightprobe.core.errors import printable
from lightprobe.imaging import srgb_encode
from lightprobe.scene.camera import Similarity
from lightprobe.scene.consistency import overlap
from lightprobe.scene.findings import converted_encodings, encoding_sentences, exposures, numbered, sizes
from lightprobe.scene.frame import Problems, Split
from lightprobe.scene.loading import THUMBNAIL, Reading, in_parallel, read_folder, unposed_sentences
from lightprobe.scene.masks import without_background
from lightprobe.scene.pixels import load_thumbnail
from lightprobe.scene.soundness import judge


@dataclass(frozen=True)
class PhotoReport:
    """What was measured on one photo."""

    name: str
    split: Split
    width: int
    height: int
    ev100: float | None
    picture: np.ndarray  # (h, w, 3) uint8 sRGB thumbnail, background included
    mask: np.ndarray  # (h, w) bool thumbnail
    silhouette: np.ndarray | None = None  # (h, w) bool, the visual hull; None without a hull

    @property
    def iou(self) -> float | None:
        """Overlap of mask and silhouette, or None without a hull."""
        return None if self.silhouette is None else overlap(self.mask, self.silhouette)


@dataclass(frozen=True)
class Inspection:
    """Everything `inspect` found; `problems` stop a fit or spoil it, `hints` are suspicions."""

    root: Path
    format: str | None
    photos: tuple[PhotoReport, ...]
    similarity: Similarity | None
    problems: tuple[str, ...]
    hints: tuple[str, ...]
    encodings: str = ""  # colour encodings that are converted, with how many photos have each
    read_files: tuple[Path, ...] = ()  # photos and masks
    light_groups: tuple[int, ...] = ()  # numbers of photos that share a light

    @property
    def mean_iou(self) -> float | None:
        """Mean overlap of hull and masks over all photos, or None without a hull."""
        values = [photo.iou for photo in self.photos if photo.iou is not None]
        return float(np.mean(values)) if values else None

    def lines(self) -> list[str]:
        """Return the findings as text for a terminal: facts, then the first 20 problems, then the hints."""
        said = numbered("problem", self.problems)
        if self.format is None:
            return [printable(line) for line in (f"scene    {self.root}", *said)]
        facts, counts = (
            [f"scene    {self.root} ({self.format} layout)"],
            Counter(p.split for p in self.photos),
        )
        facts.append("photos   " + ", ".join(f"{counts[split]} {split.value}" for split in Split))
        if self.photos:
            facts.append(sizes([(photo.width, photo.height) for photo in self.photos]))
            shares = [100 * photo.mask.mean() for photo in self.photos]
            covered = f"{min(shares):.0f} to {max(shares):.0f} % of a photo, mean {np.mean(shares):.0f} %"
            facts += [exposures([photo.ev100 for photo in self.photos]), f"masks    object covers {covered}"]
        if self.light_groups:
            facts.append(f"lights   shared by {', '.join(map(str, self.light_groups))} photos (light_group)")
        if self.encodings:
            facts.append(f"colours  converted to sRGB: {self.encodings}")
        if self.similarity is not None:
            center = ", ".join(f"{value:.4g}" for value in self.similarity.center)
            radius = f"{self.similarity.scale:.4g}"
            facts.append(f"object   centre ({center}), radius {radius} in the scene's units")
        if self.mean_iou is not None:
            facts.append(_agreement(self.photos, self.mean_iou))
        return [printable(line) for line in (*facts, *said, *numbered("hint", self.hints))]


def inspect(path: Path) -> Inspection:
    """Examine the scene in folder `path` without stopping at what is wrong with it."""
    problems = Problems(collect=True)
    reading = None
    with problems.guard():
        reading = read_folder(Path(path), problems)
    if reading is None:
        return Inspection(Path(path), None, (), None, tuple(problems.messages), ())
    photos, alphas = _measure(reading, problems)
    every = [photo for _, photo in reading.all_photos()]
    problems.messages += encoding_sentences(every)
    problems.messages += [sentence] if (sentence := without_background(alphas)[1]) else []
    others = [photo for split, photo in reading.all_photos() if split is not Split.TRAIN]
    found = judge(reading.photos[Split.TRAIN], others, alphas, reading.root)
    shown = tuple(replace(photo, silhouette=found.silhouettes.get(photo.name)) for photo in photos)
    together = Counter(photo.light_group for photo in every if photo.light_group is not None)
    return Inspection(
        reading.root,
        reading.format,
        shown,
        found.similarity,
        (*problems.messages, *found.refusals),
        (*unposed_sentences(reading.root, reading.files), *found.doubts),
        converted_encodings(photo.encoding for photo in every),
        tuple(path for photo in every for path in (photo.image_path, photo.mask_path) if path is not None),
        tuple(count for count in together.values() if count > 1),
    )


def _measure(reading: Reading, problems: Problems) -> tuple[tuple[PhotoReport, ...], dict[str, np.ndarray]]:
    """Decode every photo; return the reports of the sound ones and their small masks by name."""
    splits = {photo.name: split for split, photo in reading.all_photos()}
    reports, alphas = [], {}
    every = [photo for _, photo in reading.all_photos()]
    for photo, result in in_parallel(lambda photo: load_thumbnail(photo, THUMBNAIL), every):
        with problems.guard():
            color, alpha = result()
            picture = np.clip(srgb_encode(color) * 255 + 0.5, 0, 255).astype(np.uint8)
            alphas[photo.name] = alpha
            size, split = (photo.camera.width, photo.camera.height), splits[photo.name]
            reports.append(PhotoReport(photo.name, split, *size, photo.ev100, picture, alpha >= 0.5))
    return tuple(reports), alphas


def _agreement(photos: Sequence[PhotoReport], mean: float) -> str:
    scored = [(photo.iou, photo.name) for photo in photos if photo.iou is not None]
    worst, name = min(scored)
    median = float(np.median([value for value, _ in scored]))
    scores = f"IoU {mean:.3f} (median {median:.3f}, worst {worst:.3f}: {name})"
    return f"hull     agrees with the masks at {scores}"
