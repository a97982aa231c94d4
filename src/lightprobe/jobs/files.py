"""The files of an answer: how they are named, and how they are written."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lightprobe.core.errors import ConfigError, LightprobeWarning
from lightprobe.core.files import named_file, remove
from lightprobe.core.run import RunFolder
from lightprobe.export.light_file import PhotoFacts, write_light_file
from lightprobe.imaging import write_png
from lightprobe.jobs.request import LightOptions, Output
from lightprobe.light.display import exposure, tone_mapped
from lightprobe.light.files import light_file, other_map, write_map
from lightprobe.prediction import Prediction, check_names
from lightprobe.scene.frame import cut_name

MAPS = (Output.EXR, Output.HDR)
LOCATION = (Output.CAMERA, Output.MASK, Output.OVERLAY)
"""What locating a photo finds."""

_SUFFIXES = {
    Output.EXR: ".exr",
    Output.HDR: ".hdr",
    Output.PNG: ".png",
    Output.CONFIDENCE: ".confidence.exr",
    Output.CAMERA: ".camera.json",
    Output.MASK: ".mask.png",
    Output.OVERLAY: ".overlay.png",
}
_STEM_BYTES = 255 - len(".confidence.exr")  # of a photo's name that the names of its files can hold


@dataclass(frozen=True)
class AnswerFiles:
    """Where the files of one photo's answer go."""

    light: Path
    """The map that the light file, NAME.light.json, is named after, whether or not it is wanted itself."""
    paths: Mapping[Output, Path]
    """The wanted files."""
    known: bool = False
    """Whether camera, mask and overlay are wanted of a photo whose camera is known, too."""

    @staticmethod
    def within(folder: Path, outputs: Iterable[Output]) -> "AnswerFiles":
        """Return files of fixed names in a folder that one answer has for itself: light.exr, mask.png, ..."""
        names = {
            output: f"light{suffix}" if suffix.count(".") == 1 else suffix[1:]
            for output, suffix in _SUFFIXES.items()
        }
        paths = {output: folder / names[output] for output in outputs}
        light = next((paths[output] for output in MAPS if output in paths), folder / names[Output.EXR])
        return AnswerFiles(light, paths, known=True)

    @staticmethod
    def named(folder: Path, stem: str, outputs: Iterable[Output]) -> "AnswerFiles":
        """Return files that are named after a photo, STEM.exr and so on."""
        light = named_file(folder, stem, ".exr")
        return AnswerFiles(light, {one: named_file(folder, stem, _SUFFIXES[one]) for one in outputs})

    @property
    def location(self) -> dict[Output, Path]:
        """The wanted ones of camera, mask and overlay."""
        return {output: path for output, path in self.paths.items() if output in LOCATION}

    def write(self, prediction: Prediction, facts: PhotoFacts, options: LightOptions) -> None:
        """Write the map and all that is made from it; the light file comes last, and an older one goes first."""
        maps = [self.paths[output] for output in MAPS if output in self.paths]
        other = other_map(self.light)
        if other is not None and other not in maps:
            warnings.warn(
                f"{light_file(self.light)} told the sources of {other.name} and is now that of {self.light.name}; "
                "give maps of one folder different names.",
                LightprobeWarning,
                stacklevel=2,
            )
        remove(light_file(self.light))
        image = prediction.map(options.sun).panorama(options.height)
        for path in maps:
            write_map(path, image)
        if Output.PNG in self.paths:
            write_png(self.paths[Output.PNG], tone_mapped(image, exposure(image)))
        if Output.CONFIDENCE in self.paths:
            prediction.save_confidence(self.paths[Output.CONFIDENCE])
        copies = [path.name for path in maps[1:]]
        write_light_file(self.light, prediction, facts, options.sun, options.height, copies)


@dataclass(frozen=True)
class ChosenFiles:
    """Where a person wants the files of photos; what is not chosen is named after each photo."""

    output: Path | None = None
    """The map, .exr or .hdr, or a folder; by default RUN/predictions, with a picture and the confidence."""
    confidence: Path | None = None
    """The confidence, .exr, or a folder that is there."""
    location: Mapping[Output, Path] = field(default_factory=dict)
    """Camera, mask and overlay of a photo whose camera is found; by default beside the map."""

    def check(self, count: int) -> None:
        """Raise `ConfigError` where the files of `count` photos cannot have the chosen names."""
        for output, path in self.location.items():
            suffix = Path(_SUFFIXES[output]).suffix
            if count > 1:
                raise ConfigError(
                    f"--save-{output} names one file, {path}, but there are {count} photos; "
                    "leave it out, and each photo's file goes beside its map."
                )
            if path.suffix.lower() != suffix:
                raise ConfigError(f"--save-{output} {path} must end with {suffix}.")

    def of(self, run: RunFolder, image: Path, several: bool, options: LightOptions) -> AnswerFiles:
        """Return the files of a photo, one of `several` or alone; raise `ConfigError` for names that cannot be."""
        stem = file_stem(image)
        output = _of_photo(self.output, f"{stem}.exr", several)
        confidence = _of_photo(self.confidence, f"{stem}.confidence.exr", several)
        check_names(output, confidence)
        paths = dict[Output, Path]()
        if output is None:
            folder = run.prediction_file(stem, ".exr", options.method).parent
            paths |= AnswerFiles.named(folder, stem, (Output.EXR, Output.PNG, Output.CONFIDENCE)).paths
        else:
            folder, paths[Output(output.suffix[1:].lower())] = output.parent, output
        if confidence is not None:
            paths[Output.CONFIDENCE] = confidence
        paths |= self.location_of(folder, image)
        return AnswerFiles(output or paths[Output.EXR], paths)

    def location_of(self, folder: Path, image: Path) -> dict[Output, Path]:
        """Return where camera, mask and overlay of a photo go; those that are not chosen go into `folder`."""
        return {**AnswerFiles.named(folder, file_stem(image), LOCATION).paths, **self.location}


BY_NAME = ChosenFiles()
"""All files named after their photos."""


def file_stem(image: Path) -> str:
    """Return what the files made of a photo are named by: its stem, cut where names would grow too long."""
    return cut_name(image.stem, _STEM_BYTES)


def refuse_namesakes(images: Sequence[Path], advice: str) -> None:
    """Raise `ConfigError`, which ends with the `advice`, when two photos' files would have the same name."""
    named = dict[str, Path]()
    for image in images:
        stem = file_stem(image)
        if stem in named:
            raise ConfigError(
                f"{named[stem]} and {image} have the same name, and so would their files; {advice}."
            )
        named[stem] = image


def _of_photo(chosen: Path | None, name: str, several: bool) -> Path | None:
    """Return a file that a person chose, or the one called `name` in the chosen folder."""
    if several and is_map_name(chosen):
        raise ConfigError(f"Of several photos the maps need a folder, and {chosen} is named like one map.")
    return chosen / name if chosen is not None and (several or chosen.is_dir()) else chosen


def is_map_name(path: Path | None) -> bool:
    """Return whether a path is that of a file and of no folder."""
    return path is not None and (path.suffix.lower() in (".exr", ".hdr") or path.is_file())
