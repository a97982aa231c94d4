"""What a run keeps for locating photos."""

import pytest
import torch

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.errors import InputError
from lightprobe.localization import KnownViews
from tests.painted_object import FOCAL, SIZE


def test_views_come_back_from_their_file(views, tmp_path):
    views.save(tmp_path / "views.safetensors")
    back = KnownViews.load(tmp_path / "views.safetensors")
    assert back.focal == views.focal == FOCAL / SIZE
    for mine, theirs in ((back.landmarks, views.landmarks), (back.templates, views.templates)):
        assert all(torch.equal(value, vars(theirs)[name]) for name, value in vars(mine).items())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mask", None),
        ("photo", torch.tensor([1, 0], dtype=torch.int32)),
        ("focal", torch.tensor([0.0]).double()),
    ],
)
def test_a_damaged_file_is_named_with_the_remedy(views, tmp_path, name, value):
    path = tmp_path / "views.safetensors"
    views.save(path)
    tensors = load_tensors(path)
    if value is None:
        del tensors[name]
    elif name == "photo":
        tensors[name] = tensors[name].flip(0)
    else:
        tensors[name] = value
    save_tensors(path, tensors)
    with pytest.raises(
        InputError, match=r"views\.safetensors.*delete it, and lightprobe locate makes it again"
    ):
        KnownViews.load(path)


def test_a_file_of_an_older_version_is_called_that(views, tmp_path):
    path = tmp_path / "views.safetensors"
    views.save(path)
    tensors = load_tensors(path)
    save_tensors(path, {name: value for name, value in tensors.items() if name not in ("place", "size")})
    with pytest.raises(InputError, match=r"made by an older version; delete it, and lightprobe locate"):
        KnownViews.load(path)
