import json
import math
from dataclasses import asdict
from pathlib import Path

import pytest
import torch

from lightprobe.core.checkpoint import Checkpoints, stored_like
from lightprobe.core.config import DecomposeConfig
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.stored import TensorRule, check_tensors, read_object

FILE = Path("run/x.safetensors")
RULES = {
    "points": TensorRule(("N", 3), low=-5, high=5),
    "faces": TensorRule(("F", 3), torch.int32, below="N"),
}


def sound() -> dict[str, torch.Tensor]:
    return {"points": torch.zeros(4, 3), "faces": torch.zeros(2, 3, dtype=torch.int32)}


@pytest.mark.parametrize(
    ("name", "tensor", "words"),
    [
        ("points", None, "has no 'points'"),
        ("points", torch.full((4, 3), math.nan), "'points' holds NaN"),
        ("points", torch.full((4, 3), math.inf), "'points' holds NaN or infinity"),
        ("points", torch.full((4, 3), 9.0), "'points' holds 9 to 9, beyond -5 to 5"),
        ("points", torch.zeros(4, 2), "4 x 2 of float32, not 4 x 3"),
        ("points", torch.zeros(3), "is 3 of float32"),
        ("points", torch.zeros(0, 3), "is 0 x 3 of float32, not N x 3"),
        ("points", torch.zeros(4, 3).double(), "float64, not 4 x 3 of float32"),
        ("faces", torch.full((2, 3), 4, dtype=torch.int32), "'faces' holds 4 to 4, beyond 0 to 3"),
        ("faces", torch.full((2, 3), -1, dtype=torch.int32), "beyond 0 to 3"),
    ],
)
def test_a_tensor_against_its_rule(name, tensor, words):
    tensors = sound()
    check_tensors(tensors, RULES, FILE, "mend it")
    del tensors[name]
    if tensor is not None:
        tensors[name] = tensor
    with pytest.raises(InputError, match=rf"x\.safetensors .*{words}.*; mend it\."):
        check_tensors(tensors, RULES, FILE, "mend it")


@pytest.mark.parametrize("content", ["", "[]", "null", "{", "[" * 100_000, f"[{'1' * 5000}]", "3"])
def test_what_is_no_json_object(tmp_path, content):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(InputError, match=r"a\.json .*; mend it\."):
        read_object(tmp_path / "a.json", "mend it")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"folder.*; mend it\."):
        read_object(tmp_path / "folder", "mend it")


@pytest.mark.parametrize("kind", [DecomposeConfig])
def test_a_stored_configuration_has_the_types_of_its_fields(kind):
    stored = json.loads(json.dumps(asdict(kind())))
    assert kind.from_json(stored) == kind()
    whole = next(name for name, value in stored.items() if type(value) is int)
    real = next(name for name, value in stored.items() if type(value) is float)
    for name, value in (
        (whole, 16.5),
        (whole, "16"),
        (whole, None),
        (whole, True),
        (real, "x"),
        (real, 10**400),
    ):
        with pytest.raises(ConfigError, match=f"configuration .{name}. cannot be used"):
            kind.from_json({**stored, name: value})
    assert kind.from_json({**stored, real: 1}) == kind.from_json({**stored, real: 1.0})
    for value in ([], None, {**stored, "unknown": 1}):
        with pytest.raises(ConfigError, match="cannot be used"):
            kind.from_json(value)


@pytest.mark.parametrize(
    ("file", "content"),
    [("state.json", b"[]"), ("state.json", b'{"state": 3}'), ("state.json", b""), (None, b"")],
)
def test_a_checkpoint_with_nan_or_without_a_state_is_passed_over(tmp_path, file, content):
    checkpoints = Checkpoints(tmp_path)
    checkpoints.save(1, {"w": torch.ones(2)}, {"a": 1})
    checkpoints.save(2, {"w": torch.full((2,), math.nan if file is None else 1.0)}, {"a": 2})
    if file:
        (tmp_path / "step-000000002" / file).write_bytes(content)
    assert checkpoints.latest()[0] == 1


def test_a_checkpoint_of_another_training_is_named(tmp_path):
    """Tensors of another shape would be spread over the parameters that they are copied to."""
    tensors, parameter, checkpoints = {"w": torch.ones(1)}, torch.zeros(3), Checkpoints(tmp_path)
    with (
        pytest.raises(InputError, match=r"step-000000007 .*'w' is \[1\].*--restart"),
        checkpoints.restoring(7),
    ):
        stored_like(tensors, "w", parameter)
    with pytest.raises(InputError, match=r"step-000000007 .*'v'"), checkpoints.restoring(7):
        stored_like(tensors, "v", parameter)
