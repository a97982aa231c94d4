"""The load that does nothing is gone through whole, and what is left of it is what is printed."""

import measure_fleet


def test_every_row_of_the_load_is_in_the_index(capsys):
    assert measure_fleet.main(["load", "--rows", "2500"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("2500 rows, 25 tasks: ")
    assert "bytes per row" in said


def test_a_run_that_is_none_is_told(capsys, tmp_path):
    assert measure_fleet.main(["photos", str(tmp_path)]) == 2
    assert "not a run folder" in capsys.readouterr().err
