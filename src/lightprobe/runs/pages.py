"""Pages about runs that were evaluated before: the report of one, two against each other, and many as a gallery."""

import warnings
from collections.abc import Sequence
from pathlib import Path

from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.files import holds_files, is_file_name, refuse_replacing, shell_word, write_bytes
from lightprobe.core.run import RunFolder
from lightprobe.report import write_report
from lightprobe.report.comparison import Comparison, comparison_page
from lightprobe.report.gallery import GALLERY, gallery_page
from lightprobe.report.report import Report, read_report


def report_of(run_folder: Path | str) -> Path:
    """Return the report page of a run; raise `InputError` where there is none."""
    page = RunFolder.open(Path(run_folder)).report_file
    if not page.is_file():
        raise InputError(
            f"{run_folder} has no report; write it with: lightprobe eval {shell_word(run_folder)}"
        )
    return page


def compare_runs(run_folder: Path | str, other_folder: Path | str, page: Path) -> Comparison:
    """Write a page that sets two evaluated runs beside each other, and return what it shows.

    Warns where photos of one name are not the same photo. Raises `InputError` for runs that were not
    evaluated or have no test photo in common, `ConfigError` for a page that is not named .html.
    """
    if page.suffix.lower() != ".html":
        raise ConfigError(f"Cannot write the page as '{page.name}': name it .html.")
    folders = [Path(run_folder), Path(other_folder)]
    runs = [RunFolder.open(folder) for folder in folders]
    refuse_replacing([page], [run.report_file for run in runs])
    (first, second), (name, other) = [read_report(run) for run in runs], _names(folders)
    found = Comparison((name, other), (first, second))
    known, others = (_test_photos(run) for run in runs)
    unlike = [
        name for name in found.photos if name in known and name in others and known[name] != others[name]
    ]
    if unlike:
        warnings.warn(
            f"{len(unlike)} of {len(found.photos)} test photos that both runs have by name are different ones, such as "
            f"{unlike[0]}: the runs are of different scenes, and their differences say nothing.",
            LightprobeWarning,
            stacklevel=2,
        )
    write_bytes(page, comparison_page(found).encode())
    return found


def _test_photos(run: RunFolder) -> dict[str, str]:
    """Return the checksums of the test photos that a run's scene.json knows, by name."""
    photos = run.scene().get("photos", {}).get("test", {}) if run.scene_file.is_file() else {}
    return {
        name: str(entry.get("image_checksum")) for name, entry in photos.items() if isinstance(entry, dict)
    }


def write_gallery(run_folders: Sequence[Path | str], folder: Path) -> dict[str, Report]:
    """Write a gallery into a folder and return the runs' reports by name.

    FOLDER/index.html has a card for each run, FOLDER/NAME/index.html is its report. The pages need nothing outside of
    the folder: the reports' links to the files of the runs are left out. Raises `InputError` for a run that was not
    evaluated, `ConfigError` for no run and for a folder of other files.
    """
    if not run_folders:
        raise ConfigError("No run is named: lightprobe report RUN... --gallery FOLDER.")
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder} is a file; give --gallery a folder.")
    runs = [Path(run) for run in run_folders]
    reports = dict(zip(_names(runs), [read_report(RunFolder.open(run)) for run in runs], strict=True))
    _refuse_folder(folder, runs)
    write_bytes(folder / "index.html", gallery_page(reports).encode())  # first: it tells whose folder this is
    for name, report in reports.items():
        write_report(folder / name / "index.html", report)
    return reports


def _refuse_folder(folder: Path, runs: Sequence[Path]) -> None:
    """Raise `ConfigError` for a folder of a run, and for one with other files than a gallery's."""
    place = folder.resolve()
    owner = next((run for run in runs if run.resolve() in (place, *place.parents)), None)
    if owner is not None:
        raise ConfigError(f"{folder} belongs to the run {owner}; give --gallery another folder.")
    page = folder / "index.html"
    if holds_files(folder) and not (page.is_file() and GALLERY in page.read_text(errors="replace")):
        raise ConfigError(f"{folder} holds other files than a gallery; give --gallery another folder.")


def _names(runs: Sequence[Path]) -> list[str]:
    """Return a name for each run that can be a folder's: its own folder's, with a number where that is taken."""
    names: list[str] = []
    for run in runs:
        own = run.resolve().name
        own = own if is_file_name(own) and own != "index.html" else "run"
        choices = (own, *(f"{own}-{i}" for i in range(2, len(runs) + 2)))
        names.append(next(name for name in choices if name not in names))
    return names
