"""Only regular files of a sane size are opened: anything else is one sentence, and neither hangs nor takes
memory.
"""

import os
import signal
import socket

import pytest

from lightprobe.core.errors import InputError
from lightprobe.core.reading import BoundedFile
from lightprobe.imaging import image_size, read_hdr, read_ldr, read_mask
from lightprobe.scene import load_photo, load_scene, read_camera
from tests.scene.worlds import views, write_nerd

READERS = {"photo": read_ldr, "mask": read_mask, "size": image_size, "map": read_hdr, "camera": read_camera}


@pytest.fixture(autouse=True)
def patience():
    """End a test that waits for a pipe."""

    def give_up(*_):
        raise TimeoutError("A reader hangs.")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, reader):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(
        InputError, match=r"pipe cannot be read: it is a pipe, not a regular file; name the file"
    ):
        READERS[reader](tmp_path / "pipe")


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs a device that never ends")
@pytest.mark.parametrize("reader", ["photo", "map"])
def test_a_device_without_end_is_refused(reader):
    with pytest.raises(InputError, match=r"/dev/zero cannot be read: it is a device"):
        READERS[reader]("/dev/zero")


@pytest.mark.parametrize(("reader", "gigabytes"), [("photo", 3), ("map", 3), ("camera", 1)])
def test_a_file_too_large_to_be_right_is_refused(tmp_path, reader, gigabytes):
    with open(tmp_path / "huge", "wb") as file:
        file.truncate(gigabytes * 10**9)  # takes no room on the disk
    with pytest.raises(InputError, match=rf"huge has {gigabytes}\.0 GB, more than"):
        READERS[reader](tmp_path / "huge")


def test_pipes_in_a_scene_and_of_a_prediction(tmp_path):
    root = write_nerd(tmp_path / "scene", views(4))
    mask = root / "masks" / "view_01.png"
    mask.unlink()
    os.mkfifo(mask)
    with pytest.raises(InputError, match=r"view_01\.png has no mask"):
        load_scene(root)
    os.mkfifo(root / "camera.json")
    with pytest.raises(InputError, match=r"camera\.json cannot be read: it is a pipe"):
        load_photo(root / "images" / "view_01.png", root / "camera.json", mask)
    (root / "poses_bounds.npy").unlink()
    os.mkfifo(root / "poses_bounds.npy")
    with pytest.raises(InputError, match="no cameras; a scene folder has"):
        load_scene(root)


def test_sockets_and_names_with_a_nul(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # socket names are short
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        with pytest.raises(InputError, match="it is a socket"):
            read_ldr(tmp_path / "socket")
    with pytest.raises(InputError, match="cannot be read: embedded null"):
        read_ldr("a\0b.png")


def test_no_memory_is_taken_for_bytes_that_a_file_does_not_have(tmp_path):
    (tmp_path / "a").write_bytes(b"0123456789")
    with BoundedFile(tmp_path / "a") as file:
        assert file.read(2**62) == b"0123456789"  # for which a plain file ends in a MemoryError
        assert file.read(2**62) == file.read() == b""
        file.seek(4)
        assert (file.read(2), file.read(None)) == (b"45", b"6789")
        file.seek(20)
        assert file.read(5) == b""
