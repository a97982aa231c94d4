"""The fit of the lobes on a coarse grid: what it starts from, that it gets better, and the table it writes."""

import json

import pytest
import torch

import fit_specular_lobes as tool


@pytest.fixture
def coarse(monkeypatch):
    sizes = {"COSINES": 4, "ROUGHNESSES": 3, "RINGS": 12, "SPOKES": 8, "LAMPS": 40, "STEPS": 12}
    for name, value in sizes.items():
        monkeypatch.setattr(tool, name, value)


def test_lobes_integrate_to_one(coarse):
    cells = tool.make_cells()
    lobe, integral = tool.true_lobe(cells, 1.0)
    torch.testing.assert_close((lobe * cells.solid_angle).sum(-1), torch.ones(4, 3))
    assert float(integral.min()) > 0


def test_the_fit_gets_closer_than_its_start(coarse):
    cells = tool.make_cells()
    lamp = tool.lamps(cells)
    goals = tool.make_goals(cells, lamp)
    start = tool.parameters_of(tool.first_guess(cells))
    fitted = tool.fit(cells, lamp, goals)
    before, after = (
        sum(float(goal.errors(cells, lamp, *pair)[0].sum()) for goal in goals)
        for pair in ((start, start), fitted)
    )
    assert after < before


def test_the_command_writes_a_table_like_the_bundled_one(coarse, monkeypatch, tmp_path, capsys):
    bundled = torch.tensor(json.loads(tool.TABLE.read_text()))
    monkeypatch.setattr(tool, "TABLE", tmp_path / "lobes.json")
    tool.main()
    table = torch.tensor(json.loads(tool.TABLE.read_text()))
    assert table.shape == (2, 3, 4, bundled.shape[-1])
    assert float(table[..., 4:].sum(-1).max()) <= 1
    assert capsys.readouterr().out.count("F0 = ") == len(tool.REFLECTANCES)
