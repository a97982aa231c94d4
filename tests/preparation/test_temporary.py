"""A folder for COLMAP is there only where it will not run full."""

import shutil
from types import SimpleNamespace

import pytest

from lightprobe.core.errors import ResourceError
from lightprobe.preparation.temporary import working_folder


def test_it_is_new_and_goes_away():
    with working_folder(1000) as folder:
        assert list(folder.iterdir()) == []
        (folder / "database.db").write_bytes(b"x")
    assert not folder.exists()


def test_a_disk_that_would_run_full_is_one_sentence(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=100 << 20))
    with working_folder(30 << 20):
        pass
    with (
        pytest.raises(ResourceError, match=r"has 100 MB free, finding cameras needs 114 MB there; .* TMPDIR"),
        working_folder(50 << 20),
    ):
        pass
