"""Pixels chosen from a G-buffer take all that belongs to them along."""

import torch

from lightprobe.render.visibility import PointVisibility, VertexVisibility
from tests.gbuffers import any_gbuffer


def test_chosen_rows_keep_all_their_attributes():
    gbuffer, rows = any_gbuffer(20), torch.tensor([3, 17, 4])
    seen = VertexVisibility(torch.zeros(5, 384, dtype=torch.uint8), torch.rand(5, 3))
    index, weight = torch.randint(0, 5, (20, 3)), torch.rand(20, 3)
    whole = type(gbuffer)(**{**vars(gbuffer), "visibility": PointVisibility(seen, index, weight)})
    some = whole.select(rows)
    for name, value in vars(some).items():
        if isinstance(value, torch.Tensor):
            assert torch.equal(value, getattr(whole, name)[rows]), name
    assert (some.height, some.width) == (whole.height, whole.width)
    assert some.visibility is not None
    assert some.visibility.vertices is seen
    assert torch.equal(some.visibility.index, index[rows])
    assert torch.equal(some.visibility.weight, weight[rows])
    assert gbuffer.select(rows).visibility is None
