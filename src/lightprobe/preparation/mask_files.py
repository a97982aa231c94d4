"""The masks in a scene's folder: which of them a person changed since, and how they are written anew."""

from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.files import checksum, named_file, remove, write_bytes, write_json
from lightprobe.core.stored import read_object
from lightprobe.imaging import read_mask, write_mask
from lightprobe.preparation import writing
from lightprobe.preparation.cache import HIDDEN
from lightprobe.preparation.corrections import Corrections
from lightprobe.preparation.labelled import Masks

_WRITTEN = "written.json"  # in the hidden folder: checksums of the masks as they were written
_MADE_OF = "made-of.json"  # by name: such a checksum, and that of what the mask was made of
_CORRECTED, _CLICKED = (
    "corrected",
    "clicked",
)  # in the hidden folder: masks that a person painted, what clicks told


def written_masks(output: Path) -> dict[str, list[Any]]:
    """Return the checksums of a scene's masks as they were written, by name, none where none were.

    The newest comes first; an older one is there for a run that ended while masks took each other's place.
    Raises `InputError` for a record that is damaged.
    """
    found = _record(output, _WRITTEN)
    return {name: value if isinstance(value, list) else [value] for name, value in found.items()}


def are_written(output: Path) -> bool:
    """Return whether masks were written into a scene."""
    return (output / HIDDEN / _WRITTEN).is_file()


def own_corrections(names: Iterable[str], output: Path) -> Corrections:
    """Return what a person corrected in a scene's masks since they were written there, of the photos of some names."""
    if not are_written(output):
        return Corrections()
    written = written_masks(output)
    painted, clicked = {}, {}
    for name in names:
        path, kept, clicks = (named_file(folder, name, ".png") for folder in _folders(output))
        if path.is_file() and checksum(path) not in written.get(name, ()):
            painted[name] = read_mask(path) >= 0.5
        elif kept.is_file():
            painted[name] = read_mask(kept) >= 0.5
        if clicks.is_file():
            clicked[name] = np.rint(2 * read_mask(clicks) - 1).astype(np.int8)
    return Corrections(painted, clicked)


def corrected_names(output: Path) -> list[str]:
    """Return the names of photos of which corrections are kept."""
    folders = _folders(output)[1:]
    return sorted({path.stem for folder in folders if folder.is_dir() for path in folder.glob("*.png")})


def keep_clicks(output: Path, name: str, signs: np.ndarray) -> None:
    """Keep what clicks told of a photo, (h, w) int8 as in `Corrections`."""
    write_mask(named_file(output / HIDDEN / _CLICKED, name, ".png"), (signs.astype(np.float32) + 1) / 2)


def forget_corrections(output: Path, name: str) -> None:
    """Remove what a person corrected in the mask of a photo, and the mask."""
    remove(*(named_file(folder, name, ".png") for folder in _folders(output)))


def _folders(output: Path) -> tuple[Path, Path, Path]:
    """Return where masks are, those that a person painted, and what clicks told."""
    return output / "masks", output / HIDDEN / _CORRECTED, output / HIDDEN / _CLICKED


def write_masks(
    output: Path,
    names: Mapping[int, str],
    found: Masks,
    painted: Collection[str],
    full: Callable[[int], np.ndarray],
    done: Callable[[], None] = lambda: None,
) -> None:
    """Write the masks of a scene, in the pixels of its photos, and their checksums.

    names: of the photos, by their index. painted: names of those whose masks a person painted; they stay as they are.
    full: returns the mask (H, W) float32 of a photo; asked for those alone that are not there, from several threads. done:
    called after each photo.
    """
    folder, corrected, _ = _folders(output)
    written, known = written_masks(output), _record(output, _MADE_OF)
    before, ready = dict[str, list[str]](), dict[str, Path]()
    for photo, name in names.items():
        present, kept = (named_file(where, name, ".png") for where in (folder, corrected))
        there = checksum(present) if present.is_file() else None
        if there in written.get(name, ()):
            before[name] = [str(there)]
        elif there is not None and (name in painted or name in written):  # a person's, perhaps of this moment
            write_bytes(kept, present.read_bytes())
        if name in painted and kept.is_file():
            ready[name] = kept
        elif there is not None and known.get(name) == [there, found.keys[photo]]:
            ready[name] = present
    missing = {name: photo for photo, name in names.items() if name not in ready}
    for _ in ready:
        done()

    def record(where: Path, others: Mapping[str, list[str]]) -> None:
        sums = {name: checksum(named_file(where, name, ".png")) for name in names.values()}
        made_of = {name: [sums[name], found.keys[photo]] for photo, name in names.items()}
        write_json(output / HIDDEN / _MADE_OF, made_of)
        write_json(output / HIDDEN / _WRITTEN, {name: [sums[name], *others.get(name, [])] for name in sums})

    # If all ends while the new folder takes the old one's place, either is known not to be the user's work.
    writing.write_masks(
        missing, lambda name: full(missing[name]), ready, folder, lambda new: record(new, before), done
    )
    record(folder, {})


def as_written(path: Path, output: Path, name: str) -> bool:
    """Return whether a photo's mask is the one that was written last, or the one before."""
    return checksum(path) in written_masks(output).get(name, ())


def _record(output: Path, name: str) -> dict[str, Any]:
    path = output / HIDDEN / name
    return read_object(path, "remove it and prepare the scene anew") if path.is_file() else {}
