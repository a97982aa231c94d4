"""The bundled table of the reflectance model's integrals is the one that the tool writes."""

import pytest
import torch
from safetensors.torch import load_file

import make_brdf_table
from lightprobe.render.brdf import TABLE


@pytest.mark.slow
def test_the_tool_writes_the_table_that_is_bundled(tmp_path, monkeypatch, capsys):
    written = tmp_path / "table.safetensors"
    monkeypatch.setattr(make_brdf_table, "TABLE", written)
    make_brdf_table.main()
    assert capsys.readouterr().out == f"Table: {written}\n"
    bundled, made = load_file(TABLE), load_file(written)
    assert bundled.keys() == made.keys()
    for name, values in bundled.items():
        torch.testing.assert_close(made[name], values, rtol=1e-4, atol=1e-6)
