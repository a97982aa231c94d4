"""Work is done one piece after the other, and survives a worker that fails, dies or hangs."""

import os
import signal
import time

import pytest

from lightprobe.core.errors import InputError, ResourceError
from lightprobe.view import jobs as module
from lightprobe.view.jobs import Jobs, JobState, TaskName


@pytest.fixture
def jobs(tmp_path, worker):
    made = Jobs(tmp_path / "jobs", worker)
    yield made
    made.close()


def finished(jobs, job, seconds=20.0):
    """Return a job when it is over."""
    end = time.monotonic() + seconds
    while job.state in (JobState.WAITING, JobState.RUNNING) and time.monotonic() < end:
        time.sleep(0.02)
    return jobs.get(job.id)


def test_a_job_leaves_the_files_that_it_tells(jobs):
    job = finished(jobs, jobs.submit(TaskName.PREDICT, "photo", {"name": "good"}))
    assert (job.state, job.stage) == (JobState.DONE, "at work")
    assert job.file("light.exr").read_text() == "x"
    for name in ("../light.exr", "other", "", "/etc/passwd"):
        with pytest.raises(InputError, match="no file of that name"):
            job.file(name)


def test_a_failure_is_a_sentence_and_the_next_job_is_done(jobs):
    first = jobs.submit(TaskName.PREDICT, "photo", {"name": "fails"})
    second = jobs.submit(TaskName.PREDICT, "photo", {"name": "good"})
    assert finished(jobs, first).sentence == "This cannot be done."
    assert finished(jobs, second).state is JobState.DONE


@pytest.mark.parametrize("by", ["itself", "somebody"])
def test_a_worker_that_ends_fails_its_job_and_is_started_anew(jobs, by):
    job = jobs.submit(TaskName.PREDICT, "photo", {"name": "dies" if by == "itself" else "slow"})
    if by == "somebody":
        while job.stage != "at work":
            time.sleep(0.02)
        os.kill(jobs.worker_pid, signal.SIGKILL)
    assert finished(jobs, job).state is JobState.FAILED
    assert "has ended" in job.sentence
    assert finished(jobs, jobs.submit(TaskName.PREDICT, "photo", {"name": "good"})).state is JobState.DONE


def test_a_job_that_takes_too_long_is_stopped(jobs, monkeypatch):
    monkeypatch.setitem(module.DEADLINES, TaskName.PREDICT, 0.3)
    job = finished(jobs, jobs.submit(TaskName.PREDICT, "photo", {"name": "slow"}))
    assert "longer than" in job.sentence


def test_a_job_can_be_stopped_and_too_many_are_refused(jobs):
    running = jobs.submit(TaskName.PREDICT, "photo", {"name": "slow"})
    while running.state is not JobState.RUNNING:
        time.sleep(0.02)
    waiting = [jobs.submit(TaskName.PREDICT, "photo", {"name": "good"}) for _ in range(8)]
    with pytest.raises(ResourceError, match="waiting"):
        jobs.submit(TaskName.PREDICT, "photo", {"name": "good"})
    jobs.cancel(waiting[0].id)
    jobs.cancel(running.id)
    assert [running.sentence, waiting[0].sentence] == ["It was stopped."] * 2
    assert finished(jobs, waiting[-1]).state is JobState.DONE


def test_what_waits_when_all_is_closed_is_not_begun(tmp_path, worker):
    jobs = Jobs(tmp_path / "jobs", worker)
    running = jobs.submit(TaskName.PREDICT, "photo", {"name": "slow"})
    while running.stage != "at work":
        time.sleep(0.02)
    waiting = [jobs.submit(TaskName.PREDICT, "photo", {"name": "good"}) for _ in range(2)]
    before = jobs.worker_pid
    jobs.close()
    assert not jobs._thread.is_alive()
    assert (jobs.worker_pid, jobs._worker.alive) == (before, False)
    assert [job.state for job in (running, *waiting)] == [JobState.FAILED] * 3
    assert waiting[0].sentence == "The page is being closed."


def test_the_oldest_results_are_thrown_away(jobs, monkeypatch):
    monkeypatch.setattr(module, "_KEPT", 1)
    made = [finished(jobs, jobs.submit(TaskName.PREDICT, "photo", {"name": "good"})) for _ in range(3)]
    jobs.submit(TaskName.PREDICT, "photo", {"name": "good"})
    assert not made[0].folder.exists()
    with pytest.raises(InputError, match="no longer kept"):
        jobs.get(made[0].id)
