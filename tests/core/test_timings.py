import pytest

from lightprobe.core.run import RunFolder
from lightprobe.core.timings import PhaseTiming, forget_timing, read_timings, write_timing


def test_timings_are_kept_by_phase_and_replaced(tmp_path):
    path = tmp_path / "timings.json"
    assert read_timings(path) == {}
    write_timing(path, "decompose", PhaseTiming(3.25))
    write_timing(path, "distill", PhaseTiming(1.5, 0.5, True))
    write_timing(path, "decompose", PhaseTiming(7.5, 1.25, True))
    assert read_timings(path) == {
        "decompose": PhaseTiming(7.5, 1.25, True),
        "distill": PhaseTiming(1.5, 0.5, True),
    }
    forget_timing(path, "decompose")
    forget_timing(path, "decompose")
    assert read_timings(path) == {"distill": PhaseTiming(1.5, 0.5, True)}


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{" * 9999,
        '{"decompose": 3}',
        '{"decompose": {"seconds": -1}}',
        '{"decompose": {"seconds": true}}',
        '{"decompose": {"seconds": NaN}}',
        f'{{"decompose": {{"seconds": 1{"0" * 400}}}}}',
    ],
)
def test_a_damaged_record_counts_as_none(tmp_path, content):
    path = tmp_path / "timings.json"
    path.write_text(content)
    assert read_timings(path) == {}
    write_timing(path, "decompose", PhaseTiming(1.0))
    assert read_timings(path) == {"decompose": PhaseTiming(1.0)}


def test_a_phase_that_is_begun_anew_has_no_timing(tmp_path):
    run = RunFolder.create(tmp_path / "run")
    for phase in ("decompose", "distill"):
        run.record_config(phase, {"steps": 1})
        write_timing(run.timings_file, phase, PhaseTiming(2.0, None, True))
    run.restart("distill", outputs=())
    assert read_timings(run.timings_file) == {"decompose": PhaseTiming(2.0, None, True)}
    run.empty(outputs=())
    assert not run.timings_file.exists()
