from pathlib import Path

from lightprobe.core.run import RunFolder
from lightprobe.report.provenance import training_costs, without_places


def test_places_are_named_by_whole_folders_the_innermost_first():
    places = {"DATA": Path("/my data"), "RUNS": Path("out/runs"), "FOLDER": Path("out")}
    assert without_places("eval out/runs/a --scene /my data/a", places) == "eval RUNS/a --scene DATA/a"
    assert without_places("eval out/hdri/a --scene layout/a", places) == "eval FOLDER/hdri/a --scene layout/a"


def test_times_of_interrupted_phases_are_not_reported(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    assert training_costs(run) == {}
    for line in ("decompose starts", "decompose goes on from step 3", "decompose finished in 1:05"):
        run.log(line)
    run.log("distill finished in 0:42, 1.25 GiB at most")
    assert training_costs(run) == {"distill": 42, "memory": 1.25}
