"""Paths and URLs: what they may be, and the same files in a folder and in an object store."""

import fsspec
import pytest

from lightprobe.core.errors import ConfigError, InputError, ResourceError
from lightprobe.fleet.storage import Place


@pytest.fixture(params=["folder", "memory"])
def place(request, tmp_path):
    """An empty folder of this machine, and one of an object store."""
    if request.param == "folder":
        return Place.of(tmp_path / "place")
    store = fsspec.filesystem("memory")
    store.store.clear()
    return Place.of("memory://bucket/place")


def test_files_are_written_listed_read_and_removed(place):
    assert not place.exists()
    assert place.names() == []
    place.child("a", "one.txt").write(b"one")
    place.child("two.txt").write(b"two")
    place.child(".hidden").write(b"")
    assert place.names() == ["a", "two.txt"]
    assert place.child("a").is_folder()
    assert not place.child("two.txt").is_folder()
    assert place.child("two.txt").read() == b"two"
    assert place.child("a", "one.txt").parent == place.child("a")
    place.child("two.txt").remove()
    place.child("two.txt").remove()
    assert place.names() == ["a"]


def test_a_missing_file_and_a_large_one_are_told(place):
    with pytest.raises(InputError, match="does not exist"):
        place.child("gone").read()
    place.child("large").write(bytes(100))
    with pytest.raises(InputError, match="more than"):
        place.child("large").read(99)


def test_a_folder_of_a_store_is_fetched_without_what_is_left_out(tmp_path):
    place = Place.of("memory://bucket/run")
    for name in ("config.json", "mesh/a.bin", "env/a.exr"):
        place.child(*name.split("/")).write(name.encode())
    folder = place.fetch_folder(tmp_path / "run", ("env/",))
    found = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    assert found == ["config.json", "mesh/a.bin"]
    assert Place.of(tmp_path).fetch_folder(folder) == tmp_path


def test_names_in_a_store_lead_nowhere_else(tmp_path):
    fsspec.filesystem("memory").store.clear()
    Place.of("memory://bucket/run/config.json").write(b"{}")
    store = fsspec.filesystem("memory")
    store.store["/bucket/run/../../../evil"] = store.store["/bucket/run/config.json"]
    with pytest.raises(InputError, match="outside"):
        Place.of("memory://bucket/run").fetch_folder(tmp_path / "run")
    assert not (tmp_path.parent / "evil").exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a\0b",
        "x" * 5000,
        "http://host/photo.png",
        "zip://a::s3://b/c.zip",
        "s3://",
        "s3://bucket/../other",
    ],
)
def test_what_is_no_place_is_refused(text):
    with pytest.raises(InputError):
        Place.of(text)


@pytest.mark.parametrize("name", ["..", "", "a/b", "/etc"])
def test_children_are_plain_names(name, tmp_path):
    with pytest.raises(InputError):
        Place.of(tmp_path).child(name)


def test_relative_paths_start_beside_the_file_that_names_them(tmp_path):
    assert Place.of("a/b.png", Place.of(tmp_path)).local == tmp_path / "a" / "b.png"
    assert str(Place.of("a.png", Place.of("memory://bucket/tables"))) == "memory://bucket/tables/a.png"
    assert Place.of("/x/a.png", Place.of("memory://bucket")).local.as_posix() == "/x/a.png"
    assert Place.of(f"file://{tmp_path}/a.png").local == tmp_path / "a.png"


def test_errors_of_a_store_become_sentences(monkeypatch):
    class Broken:
        def cat_file(self, path):
            raise RuntimeError("no route\nto host")

        def info(self, path):
            return {"size": 1}

    monkeypatch.setattr(fsspec, "filesystem", lambda *_, **__: Broken())
    with pytest.raises(ResourceError, match="no route"):
        Place.of("s3://bucket/a").read()

    def missing(*_, **__):
        raise ImportError("s3fs")

    monkeypatch.setattr(fsspec, "filesystem", missing)
    with pytest.raises(ConfigError, match="pip install s3fs"):
        Place.of("s3://bucket/a").read()
