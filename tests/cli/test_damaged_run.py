"""A run whose files are damaged, or made to do harm: every command says so in one sentence, and writes no more."""

import json
import math
import random
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

from lightprobe.cli.main import main
from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_hdr
from lightprobe.light.equirect import from_cubemap
from lightprobe.light.files import write_map
from tests.toy_scene import TINY_DISTILL, TINY_WITHOUT_TRIALS, write_toy_scene

DOCUMENTED = (0, 2, 3, 4, 5)  # exit codes of `core.errors`
ODD_VALUES = ("x", -1, 10**400, 1e300, math.nan, [], {}, None, True, "\ud800", "a\0b", "../../x")
PROGRESS = re.compile(r"\w+: \d+ of \d+")
Change = Callable[[Path], None]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A scene, an environment map, and a finished run on it that has kept all its checkpoints."""
    folder = tmp_path_factory.mktemp("toy")
    scene = write_toy_scene(folder / "scene")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Checkpoints.__init__, "__defaults__", (100,))
        assert run_main("train", scene, "-o", folder / "run", *TINY_WITHOUT_TRIALS, *TINY_DISTILL) == 0
    write_map(folder / "light.exr", from_cubemap(torch.ones(6, 8, 8, 3), 16).numpy())
    return folder


class Damaged:
    """A copy of the run, with every command on it."""

    def __init__(self, trained: Path, folder: Path):
        self.run, self.out = RunFolder(folder / "run"), folder / "out"
        shutil.copytree(trained / "run", self.run.path)
        scene = trained / "scene"
        train = ("train", scene, "-o", self.run.path, *TINY_WITHOUT_TRIALS, *TINY_DISTILL)
        view = ("--camera", self.run.scene_file, "--frame", "test_00", "--env", trained / "light.exr")
        self.commands = {
            "predict": ("predict", self.run.path, scene / "test" / "test_00.png", "-o", self.out / "l.exr"),
            "export": ("export", self.run.path, "-o", self.out / "files"),
            "render": ("render", self.run.path, *view, "-o", self.out / "r.png"),
            "relight": (
                "relight",
                self.run.path,
                *view[-2:],
                "-o",
                self.out / "p",
                "--frames",
                1,
                "--side",
                8,
            ),
            "eval": ("eval", self.run.path, "--no-unseen", "--methods", "constant"),
            "train": train,
            "fit": ("fit", *train[1:4], *TINY_WITHOUT_TRIALS),
        }

    def unfinish(self, step: int) -> Path:
        """Take back all that came after the checkpoint of `step`, and return its folder."""
        shutil.rmtree(self.run.model_folder, ignore_errors=True)
        self.run.asset_file.unlink()
        for folder in self.run.checkpoints.folder.iterdir():
            if int(folder.name[5:]) > step:
                shutil.rmtree(folder)
        return self.run.checkpoints.folder / f"step-{step:09d}"


def run_main(*arguments: Any) -> int:
    return main([str(argument) for argument in arguments])


@pytest.fixture
def damaged(trained, tmp_path):
    return Damaged(trained, tmp_path)


def check(code: int, streams: Any, place: str, *, may_work: bool) -> None:
    """The exit code is a documented one; a failure is one sentence that names the place and what to do."""
    lines = [line for line in streams.err.splitlines() if line and not PROGRESS.match(line)]
    assert code in DOCUMENTED, streams.err
    assert "Unexpected error" not in streams.err
    if code:
        assert len(lines) == 1, streams.err
        assert lines[0].startswith("lightprobe: ")
        assert place in lines[0], lines[0]
    else:
        assert may_work, f"nobody noticed: {place}"


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def removed(path: Path) -> None:
    path.unlink()


def text(content: str) -> Change:
    return lambda path: path.write_text(content)


def nodes(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key) of a JSON value."""
    for key, child in value.items() if isinstance(value, dict) else enumerate(value):
        yield value, key
        if isinstance(child, dict | list):
            yield from nodes(child)


def odd_json(seed: int) -> Change:
    """One value of the file becomes another, or its key goes."""

    def change(path: Path) -> None:
        rng, value = random.Random(seed), json.loads(path.read_text())
        container, key = rng.choice(list(nodes(value)))
        if rng.random() < 0.2:
            del container[key]
        else:
            container[key] = rng.choice(ODD_VALUES)
        path.write_text(json.dumps(value))

    return change


def odd_tensor(name: str, change: Callable[[torch.Tensor], torch.Tensor | None]) -> Change:
    """The tensor whose name ends so is changed, or left out when nothing comes back."""

    def apply(path: Path) -> None:
        tensors = load_file(path)
        key = next(key for key in tensors if key.endswith(name))
        changed = change(tensors.pop(key))
        save_file(tensors if changed is None else {**tensors, key: changed.contiguous()}, path)

    return apply


def filled_first(value: float) -> Callable[[torch.Tensor], torch.Tensor]:
    def change(tensor: torch.Tensor) -> torch.Tensor:
        tensor.view(-1)[0] = value
        return tensor

    return change


def all_one_more(tensor: torch.Tensor) -> torch.Tensor:
    return tensor + 1


WHOLE_FILE = (emptied, cut, a_folder, removed, text("[]"), text("{}"), text("null"), text("[" * 100_000))
TENSORS = (
    filled_first(math.nan),
    lambda t: t[None],
    lambda t: t[:-1],
    lambda t: None,
    lambda t: t.double(),
    lambda t: t.new_zeros((0, *t.shape[1:])),
    lambda t: t.to(torch.uint8).bool(),
)
INDICES = (filled_first(2**31 - 1), filled_first(-1), all_one_more, lambda t: t.long(), lambda t: t[:, :2])


def cases(changes: Any, seeds: int = 0) -> list[Change]:
    return [*changes, *(odd_json(seed) for seed in range(seeds))]


def try_all(
    damaged: Damaged, capsys, file: Path, changes: list[Change], commands: list[str], *, may_work: bool
) -> None:
    """Apply each change alone, run the commands, and put the file back."""
    original = file.read_bytes()
    for change in changes:
        change(file)
        for command in commands:
            shutil.rmtree(damaged.out, ignore_errors=True)
            code = run_main(*damaged.commands[command])
            place = (
                "run/model/" if file.parent.name == "model" else file.name
            )  # of two that do not fit each other
            if (
                file == damaged.run.config_file
            ):  # settings that are not those of the run are named by its folder
                place = str(damaged.run.path)
            if (
                file == damaged.run.asset_file and not file.exists()
            ):  # as where the first phase has not finished
                place = "no reconstructed object"
            check(code, capsys.readouterr(), place, may_work=may_work)
            if command == "predict" and code == 0:
                assert torch.from_numpy(read_hdr(damaged.out / "l.exr")).isfinite().all()
        shutil.rmtree(file) if file.is_dir() else file.unlink(missing_ok=True)
        file.write_bytes(original)


@pytest.mark.slow
def test_names_in_a_run_are_never_paths(damaged, tmp_path, capsys):
    """A light called ../../x, with its photo in scene.json to match."""
    victim = tmp_path / "precious.exr"
    lights, record = damaged.run.mesh_folder / "lights.safetensors", damaged.run.scene()
    original = lights.read_bytes()
    for name in ("../../../precious", str(tmp_path / "precious"), "..", "a/b", "", "x\0y"):
        victim.write_bytes(b"mine")
        lights.write_bytes(original)
        tensors = load_file(lights)
        tensors[name] = tensors.pop("train_00")
        save_file(tensors, lights)
        for split in ("train", "test"):
            photos = dict(record["photos"][split])
            photos[name] = photos.pop(f"{split}_00")
            changed = {**record, "photos": {**record["photos"], split: photos}}
            damaged.run.scene_file.write_text(json.dumps(changed))
            for command in ("export", "relight"):
                assert run_main(*damaged.commands[command]) == 2
                assert len(capsys.readouterr().err.splitlines()) == 1
        assert victim.read_bytes() == b"mine"
        assert not damaged.out.exists() or not any(damaged.out.rglob("*"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes", "commands", "may_work"),
    [
        ("config.json", cases(WHOLE_FILE[:2]), ["train"], False),
        ("config.json", cases((), 12), ["eval", "train"], True),
        ("scene.json", cases(WHOLE_FILE), ["predict", "export", "render", "relight", "eval"], False),
        ("scene.json", cases((*WHOLE_FILE[:3], *WHOLE_FILE[4:])), ["train"], False),
        ("scene.json", cases((), 25), ["predict", "render"], True),
        ("metrics.jsonl", cases((emptied, cut, text("1\n{}\n"), text("{" * 9999))), ["train"], True),
        ("mesh/lights.safetensors", cases(WHOLE_FILE), ["predict", "export"], False),
        ("mesh/asset.safetensors", cases(WHOLE_FILE), ["predict", "export"], False),
        ("model/config.json", cases((emptied, cut, *WHOLE_FILE[4:])), ["predict", "train"], True),
        ("model/config.json", cases((), 15), ["predict"], True),
        ("model/light_accuracy.json", cases((*WHOLE_FILE[:3], *WHOLE_FILE[4:])), ["predict", "eval"], False),
        ("model/light_accuracy.json", cases((), 15), ["predict"], True),
        ("model/illumination_mlp.safetensors", cases(WHOLE_FILE), ["predict", "train"], False),
        ("model/sphere_net.safetensors", cases(WHOLE_FILE), ["predict", "train"], False),
    ],
)
def test_a_damaged_file_is_one_sentence(damaged, capsys, name, changes, commands, may_work):
    try_all(damaged, capsys, damaged.run.path / name, changes, commands, may_work=may_work)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "tensors"),
    [
        ("mesh/lights.safetensors", ["train_03"]),
        ("mesh/asset.safetensors", ["vertices", "uvs", "base_color", "roughness", "normal", "blockers"]),
        ("model/illumination_mlp.safetensors", ["layers.0.weight", "layers.3.bias", "mean_light", "up"]),
        ("model/sphere_net.safetensors", ["fine.0.conv.weight", "out.bias"]),
    ],
)
def test_a_damaged_tensor_is_one_sentence(damaged, capsys, name, tensors):
    changes = [odd_tensor(tensor, change) for tensor in tensors for change in TENSORS]
    try_all(damaged, capsys, damaged.run.path / name, changes, ["predict"], may_work=False)


@pytest.mark.slow
def test_an_index_beyond_its_array_is_one_sentence(damaged, capsys):
    changes = [odd_tensor(name, c) for name in ("uv_faces", "faces") for c in INDICES]
    changes += [odd_tensor("normal_faces", c) for c in INDICES if c is not all_one_more]  # that is no error
    changes += [odd_tensor("roughness", filled_first(40.0)), odd_tensor("vertices", filled_first(1e30))]
    try_all(damaged, capsys, damaged.run.asset_file, changes, ["predict"], may_work=False)


@pytest.mark.slow
def test_damaged_numbers_of_an_evaluation(damaged, capsys):
    damaged.run.metrics_file.write_text('{"methods": {"constant": {}}}')
    changes = cases((*WHOLE_FILE[:3], *WHOLE_FILE[4:], text('{"methods": []}')))
    try_all(damaged, capsys, damaged.run.metrics_file, changes, ["eval"], may_work=True)


def state(**values: Any) -> tuple[str, Change]:
    def change(file: Path) -> None:
        stored = json.loads(file.read_text())
        inner = {**stored["state"], "stage": "pass1", "iteration": 5, **values}
        file.write_text(json.dumps({**stored, "state": inner}))

    return "state.json", change


def tensor(name: str, change: Callable[[torch.Tensor], torch.Tensor | None]) -> tuple[str, Change]:
    return "tensors.safetensors", odd_tensor(name, change)


@pytest.mark.long
@pytest.mark.parametrize(
    ("step", "first", "second"),
    [(5, "distance", "offset"), (17, "displacement", "finish"), (25, "color", "finish")],
)
def test_a_checkpoint_of_another_training_is_named(damaged, capsys, step, first, second):
    """In each pass; all its files are sound in themselves."""
    folder = damaged.unfinish(step)
    misfits = [
        *(state(stage=stage) for stage in ("pass9", [])),
        *(state(iteration=iteration) for iteration in (99, "x", -1)),
        state(phase="Phase II"),
        tensor(f"parameter.{first}", lambda t: t.flatten()[:1]),
        tensor(f"parameter.{second}", lambda t: None),
        tensor("buffer.lights", lambda t: t[:1]),
        tensor(f"adam_mean.{first}", lambda t: t[:1]),
    ]
    if step > 5:
        misfits += [
            tensor("start.faces", filled_first(2**31 - 1)),
            tensor("start.roughness", lambda t: 40 * t),
        ]
    for name, change in misfits:
        original = (folder / name).read_bytes()
        change(folder / name)
        assert run_main(*damaged.commands["fit"]) == 2
        check(2, capsys.readouterr(), folder.name, may_work=False)
        (folder / name).write_bytes(original)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "change"), [("state.json", emptied), tensor("parameter.color", filled_first(math.nan))]
)
def test_a_damaged_checkpoint_is_passed_over(damaged, name, change):
    change(damaged.unfinish(25) / name)
    assert run_main(*damaged.commands["fit"]) == 0
    assert "goes on from step 20" in damaged.run.log_file.read_text()


@pytest.mark.long
def test_restart_mends_a_run_whatever_its_files_hold(damaged, capsys):
    run = damaged.run
    for file in (run.config_file, run.scene_file, run.asset_file, run.metrics_log):
        emptied(file)
    assert run_main(*damaged.commands["train"]) == 2
    assert "--restart" in capsys.readouterr().err
    assert run_main(*damaged.commands["train"], "--restart") == 0
    assert run_main(*damaged.commands["predict"]) == 0
