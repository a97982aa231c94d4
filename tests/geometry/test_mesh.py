import pytest
import torch

from lightprobe.geometry.mesh import is_closed
from tests.shapes import sphere

VERTICES, FACES = (torch.from_numpy(part) for part in sphere(1))


def test_a_sphere_is_closed():
    assert is_closed(VERTICES, FACES)
    assert is_closed(torch.cat([VERTICES, VERTICES + 3]), torch.cat([FACES, FACES + len(VERTICES)]))


@pytest.mark.parametrize(
    "faces",
    [
        pytest.param(FACES[1:], id="a hole"),
        pytest.param(FACES.flip(1), id="inside out"),
        pytest.param(torch.cat([FACES[:1].flip(1), FACES[1:]]), id="one face the wrong way round"),
        pytest.param(torch.cat([FACES, FACES[:1]]), id="a face twice"),
    ],
)
def test_other_surfaces_are_not(faces):
    assert not is_closed(VERTICES, faces)
