"""The command finds every measurement, and the pages are those of the repository's records."""

from pathlib import Path

import pytest

from benchmarks.__main__ import MEASUREMENTS, main
from benchmarks.speed import page
from benchmarks.speed.kernels import LOBE, stacking_kernels

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", MEASUREMENTS)
def test_every_measurement_explains_itself(name, capsys):
    pytest.importorskip({"fleet": "pyarrow", "service": "httpx2"}.get(name, "lightprobe"))
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert f"python -m benchmarks {name}" in capsys.readouterr().out


def test_an_unknown_measurement_is_refused_and_the_known_ones_named(capsys):
    assert main(["nothing"]) == 2
    printed = capsys.readouterr().out
    assert all(f"  {name} " in printed for name in MEASUREMENTS)


def test_the_results_page_is_that_of_the_records(tmp_path, capsys):
    records = ROOT / "benchmarks" / "records"
    assert main(["tables", "--records", str(records), "--results", str(tmp_path / "R.md")]) == 0
    assert (tmp_path / "R.md").read_bytes() == (ROOT / "benchmarks" / "RESULTS.md").read_bytes()
    assert main(["tables", "--records", str(tmp_path)]) != 0
    assert "no record" in capsys.readouterr().err


def test_stacking_claims_the_work_of_its_pairs():
    forward, backward, weight = (kernel.work for kernel in stacking_kernels(16))
    pairs = 16 * 6 * 64 * 64
    assert (forward, backward, weight) == (pairs * (LOBE + 8), pairs * (LOBE + 6), pairs * (LOBE + 2))


@pytest.mark.long
def test_the_speed_of_everything_is_measured():
    text = page(quick=True)
    for title in (
        "| kernel |",
        "| object pixels |",
        "| texels of the light |",
        "| triangles |",
        "| photos, ms |",
    ):
        assert title in text
    assert "nan" not in text
