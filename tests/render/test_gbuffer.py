"""Pixels chosen from a G-buffer take all that belongs to them along."""

from dataclasses import replace

import torch

from lightprobe.render.gbuffer import GBuffer
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
    for one in (whole, gbuffer):
        again = one.holding(one.tensors())
        assert all(torch.equal(a, b) for a, b in zip(again.tensors(), one.tensors(), strict=True))
        assert (again.visibility is None) == (one.visibility is None)


def test_views_stand_one_below_the_other():
    """A pixel keeps its column, and its row counts from where its view begins."""
    table = VertexVisibility(torch.zeros(5, 384, dtype=torch.uint8), torch.rand(5, 3))
    views = []
    for count, width in ((6, 3), (8, 4)):
        seen = PointVisibility(table, torch.randint(0, 5, (count, 3)), torch.rand(count, 3))
        views.append(replace(any_gbuffer(count), height=2, width=width, visibility=seen))
    both = GBuffer.one_below_the_other(views)
    assert (both.height, both.width) == (4, 4)
    assert both.pixel.tolist() == [0, 1, 2, 4, 5, 6, *range(8, 16)]
    for name in ("normal", "view", "roughness", "face"):
        assert torch.equal(getattr(both, name), torch.cat([getattr(view, name) for view in views])), name
    assert both.visibility is not None
    assert both.visibility.vertices is table
    assert torch.equal(both.visibility.index[6:], views[1].visibility.index)
    assert GBuffer.one_below_the_other([replace(view, visibility=None) for view in views]).visibility is None
