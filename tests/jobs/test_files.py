"""Where predictions go."""

from pathlib import Path

import pytest
from lightprobe.runs.predictions import MapFiles, PredictionFiles

from lightprobe.core.run import RunFolder


@pytest.mark.parametrize("stem", ["x" * 250, "漢" * 83])
@pytest.mark.parametrize(("several", "folder"), [(False, None), (True, Path("maps"))])
def test_the_longest_names_of_photos_leave_room_for_those_of_their_maps(tmp_path, stem, several, folder):
    """A photo's name may have 255 bytes, and its maps' as well: known before any work, not after it."""
    files = PredictionFiles(output=folder, confidence=folder)
    maps = MapFiles.of(RunFolder(tmp_path), Path(f"{stem}.jpg"), several, None, files)
    names = [maps.output, maps.output.with_suffix(".confidence.exr"), maps.confidence or maps.output]
    assert max(len(file.name.encode()) for file in names) <= 255
    assert stem.startswith(maps.output.stem)


def test_the_map_of_one_photo_goes_into_a_folder_that_is_there(tmp_path):
    folder = tmp_path / "maps"
    files = PredictionFiles(output=folder, confidence=folder)
    folder.mkdir()
    maps = MapFiles.of(RunFolder(tmp_path), Path("new.jpg"), several=False, method=None, files=files)
    assert (maps.output, maps.confidence) == (folder / "new.exr", folder / "new.confidence.exr")
