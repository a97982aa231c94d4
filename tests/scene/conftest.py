"""Scenes of four photos in every layout, to be damaged."""

import pytest

from tests.scene.worlds import COUNT, views, write_colmap, write_nerd, write_nerfstudio


@pytest.fixture
def nerd(tmp_path):
    return write_nerd(tmp_path / "scene", views(COUNT))


@pytest.fixture
def nerfstudio(tmp_path):
    return write_nerfstudio(tmp_path / "scene", views(COUNT))


@pytest.fixture
def colmap(tmp_path):
    return write_colmap(tmp_path / "scene", views(COUNT), binary=True)
