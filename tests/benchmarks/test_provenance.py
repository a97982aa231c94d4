from pathlib import Path

from benchmarks.provenance import training_costs, without_places
from lightprobe.core.run import RunFolder
from lightprobe.core.timings import PhaseTiming, write_timing


def test_places_are_named_by_whole_folders_the_innermost_first():
    places = {"DATA": Path("/my data"), "RUNS": Path("out/runs"), "FOLDER": Path("out")}
    assert without_places("eval out/runs/a --scene /my data/a", places) == "eval RUNS/a --scene DATA/a"
    assert without_places("eval out/hdri/a --scene layout/a", places) == "eval FOLDER/hdri/a --scene layout/a"


def test_costs_are_those_of_finished_phases(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    assert training_costs(run) == {}
    run.log("distill finished in 0:42, 1.25 GiB at most")  # as runs of before there was a record
    write_timing(run.timings_file, "decompose", PhaseTiming(65.25, 2.0))
    assert training_costs(run) == {}
    write_timing(run.timings_file, "distill", PhaseTiming(42.375, 1.254, True))
    assert training_costs(run) == {"distill": 42, "memory": 1.25}
    write_timing(run.timings_file, "decompose", PhaseTiming(90.5, 2.5, True))
    assert training_costs(run) == {"decompose": 90, "distill": 42, "memory": 2.5}
