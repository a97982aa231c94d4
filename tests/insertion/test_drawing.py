"""Drawing a virtual object: what a normal map bends on the front of a sheet, it bends the other way on the back."""

from dataclasses import replace
from types import SimpleNamespace

import torch

from lightprobe.geometry.mesh import Mesh, uv_tangents
from lightprobe.insertion.drawing import _seen_from_behind
from lightprobe.render.asset import mapped_normals
from lightprobe.render.surface import Surface

CORNERS = torch.tensor([[0.0, 0, 0], [1, 0, 0.2], [0.3, 1, 0]])
UVS = torch.tensor([[0.1, 0.2], [0.8, 0.3], [0.2, 0.9]])


def test_a_relief_on_the_back_of_a_sheet_is_that_of_the_front_reversed():
    """As glTF has it: the front's normal, bent by the map, is turned round as a whole."""
    up = torch.linalg.cross(CORNERS[1] - CORNERS[0], CORNERS[2] - CORNERS[0])
    up = (up / up.norm()).expand(3, 3)
    faces = torch.tensor([[0, 1, 2], [3, 5, 4]]).int()  # the face, and its copy that looks the other way
    mesh = Mesh(CORNERS.repeat(2, 1), faces, UVS.repeat(2, 1), faces)
    normals, tangents = torch.cat([up, -up]), uv_tangents(mesh)
    virtual = SimpleNamespace(twin=torch.tensor([1, 0]))
    mapped = torch.nn.functional.normalize(torch.tensor([[0.5, -0.3, 0.8]]), dim=1)
    front = Surface(torch.tensor([0]), torch.tensor([0]), torch.tensor([[0.2, 0.3, 0.5]]), None, None)
    back = replace(front, face=torch.tensor([1]), barycentric=front.barycentric[:, [0, 2, 1]])
    seen, behind = (
        mapped_normals(side, mesh, normals, tangents, _seen_from_behind(virtual, side.face, mapped))
        for side in (front, back)
    )
    torch.testing.assert_close(behind, -seen)
    assert float((seen - up[:1]).norm()) > 0.3
