"""What follows from Phase I's settings."""

import dataclasses

import pytest

from lightprobe.core.config import DecomposeConfig, Preset, settings


@pytest.mark.parametrize(("cells", "side"), [(8, 64), (63, 504), (64, 512), (128, 512)])
def test_depth_maps_are_as_fine_as_the_lattice_but_no_finer_than_usual(cells, side):
    assert dataclasses.replace(DecomposeConfig(), lattice_cells=cells).depth_map_side == side


def test_no_preset_has_coarse_depth_maps():
    assert {settings(preset).decompose.depth_map_side for preset in Preset} == {512}


def test_roughness_is_pulled_less_late_and_never_in_the_paper():
    quick, paper = settings("quick").decompose, settings("paper").decompose
    assert 0 < quick.late_roughness_prior < quick.roughness_prior
    assert paper.metallic_prior == paper.roughness_prior == paper.late_roughness_prior == 0
