"""Where the files of answers go, and what is refused before any work."""

from pathlib import Path

import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.core.run import RunFolder
from lightprobe.jobs import AnswerFiles, ChosenFiles, LightOptions, Output, locate_photos
from lightprobe.jobs.files import LOCATION

OPTIONS = LightOptions()


@pytest.mark.parametrize("stem", ["x" * 250, "漢" * 83])
@pytest.mark.parametrize(("several", "folder"), [(False, None), (True, Path("maps"))])
def test_the_longest_names_of_photos_leave_room_for_those_of_their_maps(tmp_path, stem, several, folder):
    """A photo's name may have 255 bytes, and its maps' as well: known before any work, not after it."""
    files = ChosenFiles(folder, folder).of(RunFolder(tmp_path), Path(f"{stem}.jpg"), several, OPTIONS)
    names = [*files.paths.values(), files.light.with_suffix(".light.json")]
    assert max(len(path.name.encode()) for path in names) <= 255
    assert stem.startswith(files.light.stem)


def test_the_map_of_one_photo_goes_into_a_folder_that_is_there(tmp_path):
    (tmp_path / "maps").mkdir()
    chosen = ChosenFiles(tmp_path / "maps", tmp_path / "maps", {Output.MASK: Path("m.png")})
    files = chosen.of(RunFolder(tmp_path), Path("photos/new.jpg"), False, OPTIONS)
    assert files.light == files.paths[Output.EXR] == tmp_path / "maps/new.exr"
    assert files.paths[Output.CONFIDENCE] == tmp_path / "maps/new.confidence.exr"
    assert files.location == {
        Output.CAMERA: tmp_path / "maps/new.camera.json",
        Output.MASK: Path("m.png"),
        Output.OVERLAY: tmp_path / "maps/new.overlay.png",
    }


def test_a_folder_of_its_own_has_files_of_fixed_names(tmp_path):
    files = AnswerFiles.within(tmp_path, [Output.HDR, Output.CONFIDENCE, *LOCATION])
    names = [path.name for path in files.paths.values()]
    assert names == ["light.hdr", "confidence.exr", "camera.json", "mask.png", "overlay.png"]
    assert files.light.name == "light.hdr"
    assert AnswerFiles.within(tmp_path, [Output.MASK]).light.name == "light.exr"


@pytest.mark.parametrize(
    ("location", "count", "words"),
    [
        ({Output.CAMERA: Path("c.txt")}, 1, r"--save-camera c\.txt must end with \.json"),
        ({Output.OVERLAY: Path("o.png")}, 2, r"--save-overlay names one file.*2 photos"),
    ],
)
def test_names_that_cannot_serve_are_refused(location, count, words):
    with pytest.raises(ConfigError, match=words):
        ChosenFiles(location=location).check(count)


def test_photos_whose_files_would_meet_are_refused_before_any_work(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    photo, other = tmp_path / "a/x.png", tmp_path / "b/x.jpg"
    for second in (other, photo):
        with pytest.raises(ConfigError, match=f"^{photo} and {second} have the same name"):
            locate_photos(run.path, [photo, second])
    with pytest.raises(ConfigError, match="No photo is named"):
        locate_photos(run.path, [])
