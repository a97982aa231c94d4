"""Where predictions go."""

from pathlib import Path

import pytest

from lightprobe.core.run import RunFolder
from lightprobe.runs.predictions import _Job


@pytest.mark.parametrize("stem", ["x" * 250, "漢" * 83])
@pytest.mark.parametrize(("several", "folder"), [(False, None), (True, Path("maps"))])
def test_the_longest_names_of_photos_leave_room_for_those_of_their_maps(tmp_path, stem, several, folder):
    """A photo's name may have 255 bytes, and its maps' as well: known before any work, not after it."""
    job = _Job.of(RunFolder(tmp_path), Path(f"{stem}.jpg"), several, None, None, folder, folder)
    files = [job.output, job.output.with_suffix(".confidence.exr"), job.confidence or job.output]
    assert max(len(file.name.encode()) for file in files) <= 255
    assert stem.startswith(job.output.stem)
