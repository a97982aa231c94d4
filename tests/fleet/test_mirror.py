"""A run in an object store: what is sent, in which order, and what is brought back."""

import os

import fsspec
import pytest
import torch

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.fleet.mirror import Mirror
from lightprobe.fleet.storage import Place
from lightprobe.preparation import check_output


@pytest.fixture
def remote():
    fsspec.filesystem("memory").store.clear()
    return Place.of("memory://bucket/runs/cup")


def write(folder, name, text, at):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    os.utime(folder / name, (at, at))


def test_files_go_in_the_order_of_their_writing_and_removed_ones_last(monkeypatch, remote, tmp_path):
    happened = []
    write_, remove = Place.write, Place.remove
    monkeypatch.setattr(Place, "write", lambda self, data: (happened.append(self.name), write_(self, data)))
    monkeypatch.setattr(Place, "remove", lambda self: (happened.append(f"-{self.name}"), remove(self)))
    mirror = Mirror(tmp_path, remote)
    write(tmp_path, "mesh/asset.safetensors", "last", 300)
    write(tmp_path, "config.json", "first", 100)
    write(tmp_path, "checkpoints/step-1/state.json", "second", 200)
    write(tmp_path, ".lock", "", 50)
    mirror.send()
    assert happened == ["config.json", "state.json", "asset.safetensors"]
    happened.clear()
    write(tmp_path, "checkpoints/step-2/state.json", "third", 400)
    (tmp_path / "checkpoints" / "step-1" / "state.json").unlink()
    mirror.send()
    assert happened == ["state.json", "-state.json"]
    left = ["checkpoints/step-2/state.json", "config.json", "mesh/asset.safetensors"]
    assert sorted(remote.files()) == left


def test_a_checkpoint_of_which_only_a_part_took_another_s_place_cannot_be_read(monkeypatch, remote, tmp_path):
    here = Checkpoints(tmp_path / "here" / "checkpoints")
    here.save(1, {"x": torch.zeros(2)}, {"pass": 1})
    here.save(2, {"x": torch.ones(2)}, {"pass": 1})
    mirror = Mirror(tmp_path / "here", remote)
    mirror._sent = {}
    mirror.send()
    here.save(2, {"start": torch.ones(3)}, {"pass": 2})
    write_, sent = Place.write, []

    def once(self, data):
        if sent:
            raise OSError("The store does not answer.")
        sent.append(self.name)
        write_(self, data)

    monkeypatch.setattr(Place, "write", once)
    with pytest.raises(OSError, match="does not answer"):
        mirror.send()
    Mirror(tmp_path / "there", remote)
    step, tensors, state = Checkpoints(tmp_path / "there" / "checkpoints").latest()
    assert (step, list(tensors), state) == (1, ["x"], {"pass": 1})


def test_what_is_there_is_brought_and_not_sent_again(monkeypatch, remote, tmp_path):
    for name in ("config.json", "checkpoints/step-1/state.json", "report/index.html"):
        remote.child(*name.split("/")).write(b"x")
    mirror = Mirror(tmp_path / "run", remote)
    here = tmp_path / "run"
    found = sorted(path.relative_to(here).as_posix() for path in here.rglob("*") if path.is_file())
    assert found == ["checkpoints/step-1/state.json", "config.json"]
    monkeypatch.setattr(Place, "write", lambda self, data: pytest.fail(f"{self} was sent again"))
    mirror.send()
    assert "report/index.html" in remote.files()


def test_another_machine_can_go_on_with_a_scene_that_was_prepared_in_the_run(remote, tmp_path):
    mirror = Mirror(tmp_path / "one", remote)
    kept = ["scene/.prepare/lock", "scene/.prepare/written.json", "scene/transforms.json"]
    for name in (*kept, ".lock"):
        write(tmp_path / "one", name, "{}", 100)
    mirror.send()
    assert sorted(remote.files()) == kept
    Mirror(tmp_path / "two", remote)
    check_output(tmp_path / "two" / "scene")


def test_changes_are_sent_now_and_then(remote, tmp_path):
    mirror = Mirror(tmp_path, remote)
    write(tmp_path, "config.json", "{}", 1)
    mirror.on_progress("pass1", 1, 9)
    assert remote.files() == []
    mirror = Mirror(tmp_path / "other", remote, every=0.0)
    write(tmp_path / "other", "config.json", "{}", 1)
    mirror.on_progress("pass1", 2, 9, "loss 1")
    assert remote.files() == ["config.json"]
