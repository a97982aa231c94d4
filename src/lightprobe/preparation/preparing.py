"""Plain photos in, a scene folder out: the steps in their order, each kept."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import ConfigError
from lightprobe.core.files import checksum, disk_errors, holds_files, locked_file
from lightprobe.preparation import learned, salient_object
from lightprobe.preparation.cache import HIDDEN, Cache, array_key, key_of
from lightprobe.preparation.candidates import Choice, choose, kept_choice, with_exact_cameras
from lightprobe.preparation.judging import inside_masks, spread
from lightprobe.preparation.looking import look_at_all, match_all, match_pairs, refuse_copies
from lightprobe.preparation.mapping import Matches, Pair
from lightprobe.preparation.mask_files import own_corrections
from lightprobe.preparation.masks import cut_masks
from lightprobe.preparation.options import PrepareOptions, all_hints, find_photo
from lightprobe.preparation.output import finished, write_scene
from lightprobe.preparation.photos import FEWEST, SourcePhoto, source_photos
from lightprobe.preparation.upright import parse_up

OnProgress = Callable[[str, int, int], None]

_EDITION = 6  # raised when finished scenes would come out otherwise: the same command then makes them anew
_LOCK = "lock"  # in the hidden folder, from when `output` was found to be empty


@dataclass(frozen=True)
class Prepared:
    """What `prepare` made."""

    folder: Path
    report: dict[str, Any]  # the content of prepare.json

    @property
    def warnings(self) -> list[str]:
        """Return the sentences about what may be wrong."""
        return list(self.report["warnings"])


def prepare(
    folder: Path,
    output: Path,
    options: PrepareOptions = PrepareOptions(),  # noqa: B008
    on_progress: OnProgress = lambda stage, done, total: None,
) -> Prepared:
    """Find cameras, masks and an upright frame for the photos in `folder`, and write a scene into `output`.

    The scene has images/, masks/, transforms.json, prepare.json and contact.png; hidden in it lies what is
    worked out, so that the same call goes on after an interruption, with masks that were corrected in masks/,
    or with a box that hint.json there names. Raises `InputError` for photos from which no scene can be made,
    `ConfigError` for options that cannot be used, `ResourceError` when another process writes `output`.
    """
    photos = source_photos(Path(folder))
    refuse_copies(photos, FEWEST)
    hints = all_hints(options.hint, Path(output), photos)
    if options.up is not None:
        parse_up(options.up)
    if options.height is not None and not 0 < options.height < float("inf"):
        raise ConfigError(
            f"--height {options.height:g} is no length; give the object's height as a number above 0."
        )
    if options.up_photo is not None:
        find_photo(photos, options.up_photo, "--up-photo")
    output = Path(output)
    check_output(output)
    with disk_errors(output):
        (output / HIDDEN).mkdir(parents=True, exist_ok=True)
    with locked_scene(output):
        given = _key(photos)
        whole = key_of(_EDITION, given, _checksums(hints), asdict(options))
        report = finished(output, whole)
        if report is None:
            report = _work(photos, hints, options, (given, whole), output, on_progress)
    return Prepared(output, report)


def locked_scene(output: Path) -> AbstractContextManager[None]:
    """Keep other processes from writing a scene; raise `ResourceError` when one does."""
    busy = f"{output} is being prepared by another process; wait for it to end."
    return locked_file(output / HIDDEN / _LOCK, busy)


def _key(photos: Sequence[SourcePhoto]) -> str:
    """Return the checksum of photos, their masks, and what features are found by."""
    masks = [None if photo.mask is None else checksum(photo.mask) for photo in photos]
    return key_of(
        [photo.checksum for photo in photos], masks, learned.is_installed(), salient_object.is_installed()
    )


def _checksums(hints: Mapping[int, np.ndarray]) -> list[tuple[int, str]]:
    """Return the checksum of each hint (H, W), with its photo."""
    return [(index, array_key(mask)) for index, mask in hints.items()]


def _work(
    photos: Sequence[SourcePhoto],
    hints: Mapping[int, np.ndarray],
    options: PrepareOptions,
    keys: tuple[str, str],
    output: Path,
    on_progress: OnProgress,
) -> dict[str, Any]:
    """Do what is left to do, and return what prepare.json holds. keys: of the photos alone, and of all.

    Hints have a vote on cameras only where there are several reconstructions to choose from: otherwise they are
    about masks, and cameras stay as they were found.
    """
    cache = Cache(output / HIDDEN)
    seen = look_at_all(photos, cache, lambda done, total: on_progress("features", done, total))
    matches = match_all(photos, seen, cache, lambda done, total: on_progress("matches", done, total))
    features, focal = [each.features for each in seen], [photo.focal_ratio for photo in photos]
    given = {index: each.given >= 0.5 for index, each in enumerate(seen) if each.given is not None}
    known = {**{index: mask >= 0.5 for index, mask in hints.items()}, **given}
    corrections = own_corrections([photo.name for photo in photos], output)

    def match_more(pairs: list[Pair]) -> Matches:
        return match_pairs(photos, seen, pairs, lambda done, total: on_progress("more matches", done, total))

    def cameras(shown: Mapping[int, np.ndarray]) -> Choice:
        inside = inside_masks(features, shown) if shown else None
        if inside is not None and len(shown) < len(features):
            inside = spread(inside, matches)

        def on_model(name: str) -> None:
            on_progress(f"cameras: {name}", 0, 1)

        chosen, used = choose(features, matches, focal, inside, seed=options.seed, on_model=on_model)
        on_progress("cameras: placing", 0, 1)
        return with_exact_cameras(chosen, features, used, [each.grey for each in seen], match_more)

    choice = kept_choice(cache, "cameras", key_of(_EDITION, keys[0], options.seed), lambda: cameras(given))
    hinted = key_of(_EDITION, keys[0], [photo.name for photo in photos], _checksums(hints), options.seed)
    if hints and len(choice.tried) > 1:
        choice = kept_choice(cache, "cameras-by-hint", hinted, lambda: cameras(known))
    cutting = cut_masks(photos, seen, choice, known, set(given), corrections, cache, hinted, on_progress)
    return write_scene(output, photos, seen, matches, cutting, options, keys[1], on_progress)


def check_output(output: Path) -> None:
    """Raise `ConfigError` for an output that is a file or a folder with something else in it."""
    if output.exists() and not output.is_dir():
        raise ConfigError(f"{output} is a file; choose another folder with -o.")
    ours = (output / HIDDEN / _LOCK).is_file()  # frames of a video alone may lie there, too
    if not ours and holds_files(output):
        raise ConfigError(
            f"{output} is not empty and was not made by prepare; choose another folder with -o."
        )
