"""The painted object, what is known of it, and one photo of it, for all tests of the package."""

import pytest

from lightprobe.localization import KnownViews
from lightprobe.localization.appearance import PhotoPyramid
from lightprobe.localization.known_object import KnownObject
from tests.painted_object import decomposition, painted_asset, painted_scene, photo_of, view_from


@pytest.fixture(scope="session")
def asset():
    return painted_asset()


@pytest.fixture(scope="session")
def known(asset):
    return KnownObject(asset)


@pytest.fixture(scope="session")
def scene(asset, tmp_path_factory):
    return painted_scene(tmp_path_factory.mktemp("painted"), asset)


@pytest.fixture(scope="session")
def views(asset, scene):
    return KnownViews.of(decomposition(asset), scene)


@pytest.fixture(scope="session")
def camera():
    """A normalised-frame camera that none of the training photos has."""
    return view_from((2.5, 1.5, 1.2), shift=0.15)


@pytest.fixture(scope="session")
def photo(asset, camera):
    return photo_of(asset, camera, 20)


@pytest.fixture(scope="session")
def pyramid(photo):
    return PhotoPyramid(photo[0])
