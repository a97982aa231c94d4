"""Tasks are done by the processes of a pool, whatever becomes of these."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lightprobe.core.errors import InputError, ResourceError
from lightprobe.core.failures import UnexpectedError
from lightprobe.web.errors import RefusedError, WorkerEndedError
from lightprobe.web.pool import Event, Pool, SlotState, Task, TaskState
from tests.web.processes import FakeProcess


@pytest.fixture
def pools():
    """Make pools that are closed at the end, with the processes that each has started."""
    made = []

    def make(new_process=FakeProcess, **options):
        started = []

        def new(number):
            started.append(new_process(number))
            return started[-1]

        made.append(Pool(new, **{"limit": 100, **options}))
        return made[-1], started

    yield make
    for pool in made:
        pool.close()


def submit(pool, what="good", object="", seconds=20.0, **options):
    task = Task(request={"what": what, "object": object}, object=object, seconds=seconds, **options)
    pool.submit(task)
    return task


def until(true):
    end = time.monotonic() + 10
    while not true():
        assert time.monotonic() < end
        time.sleep(0.002)


_WORK = st.sampled_from(["good", "fail", "break", "die", "die once"])


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(_WORK, st.sampled_from("abc")), max_size=12), st.integers(1, 3))
def test_every_task_has_its_end(works, slots):
    pool = Pool(FakeProcess, limit=100, slots=slots, tries=2)
    try:
        tasks = [submit(pool, *work) for work in works]
        errors = {"fail": InputError, "break": UnexpectedError, "die": RefusedError}
        for (what, _), task in zip(works, tasks, strict=True):
            assert type(task.answer.exception(20)) is errors.get(what, type(None))
            assert task.tries == (2 if what.startswith("die") else 1)
            assert task.passed <= 8
            assert task.state is (TaskState.FAILED if what in errors else TaskState.DONE)
    finally:
        pool.close()


def test_an_object_stays_with_the_process_that_has_it_and_others_are_woken_at_once(pools):
    """A slot that leaves the oldest task to the slot that has its object loaded must not sleep on the next one."""
    pool, started = pools(slots=2)
    until(lambda: [slot.state for slot in pool.slots] == [SlotState.IDLE] * 2)
    held = [submit(pool, "wait", object=name) for name in ("cup", "vase")]  # one on each slot
    until(lambda: [task.state for task in held] == [TaskState.RUNNING] * 2)
    for process in started:
        process.go.set()
    pids = {}
    begun = time.monotonic()
    for _ in range(30):
        until(lambda: [slot.state for slot in pool.slots] == [SlotState.IDLE] * 2)
        for task in [submit(pool, object=name) for name in ("cup", "vase")]:
            pids.setdefault(task.object, set()).add(task.answer.result(20)["pid"])
    assert time.monotonic() - begun < 30 * 0.25  # a slot that sleeps does so for half a second
    assert {name: len(seen) for name, seen in pids.items()} == {"cup": 1, "vase": 1}


def test_an_older_task_is_passed_over_eight_times_at_most(pools):
    pool, (process,) = pools()
    submit(pool, object="cup").answer.result(20)
    held = submit(pool, "wait", object="cup")
    until(lambda: held.state is TaskState.RUNNING)
    order = []
    for name in ["vase", *["cup"] * 12]:
        task = submit(pool, object=name)
        task.answer.add_done_callback(lambda _, name=name: order.append(name))
    process.go.set()
    task.answer.result(20)
    assert order.index("vase") == 8


def test_a_full_queue_is_told_and_what_is_dropped_or_stopped_makes_room(pools):
    pool, (process,) = pools(limit=2)
    running = submit(pool, "wait")
    until(lambda: running.state is TaskState.RUNNING)
    first, second = submit(pool), submit(pool)
    with pytest.raises(RefusedError, match="2 requests wait already"):
        submit(pool)
    assert pool.drop(first)
    assert not pool.drop(running)
    pool.stop(running)
    assert str(running.answer.exception(1)) == "It was stopped."
    assert second.answer.result(20)["pid"] != process.pid


def test_a_deadline_frees_the_slot(pools):
    heard = []
    pool, _ = pools(note=lambda event, **values: heard.append((event, values.get("reason"))))
    running = submit(pool, "wait", seconds=0.2, waiting_counts=False)
    waiting = submit(pool, seconds=0.05)
    with pytest.raises(RefusedError, match=r"still waiting after 0\.05 s"):
        waiting.answer.result(20)
    with pytest.raises(RefusedError, match=r"not finished after 0\.2 s"):
        running.answer.result(20)
    assert submit(pool).answer.result(20)
    assert (Event.ENDED, "deadline") in heard


def test_a_process_that_takes_too_much_memory_is_replaced(pools, monkeypatch):
    monkeypatch.setattr("lightprobe.web.pool.resident_bytes", lambda pid: 100)
    pool, _ = pools(memory=10)
    first, second = (submit(pool).answer.result(20)["pid"] for _ in range(2))
    assert first != second  # retired after a task
    with pytest.raises(RefusedError, match="needs more memory"):
        submit(pool, "wait").answer.result(20)


def test_a_task_that_may_be_tried_once_tells_that_its_process_ended(pools):
    pool, _ = pools(lazy=True)
    with pytest.raises(WorkerEndedError):
        submit(pool, "die").answer.result(20)
    task = submit(pool)
    task.answer.result(20)
    assert task.stage == "at work"


def test_a_process_that_does_not_start_is_tried_again_or_fails_the_task(pools):
    heard, starts = [], [True, False]
    pool, _ = pools(
        lambda number: FakeProcess(starts=starts.pop()), note=lambda event, **values: heard.append(event)
    )
    task = submit(pool)
    assert not pool.ready
    assert task.answer.result(20)
    assert heard == [Event.FAILED, Event.STARTED]
    lazy, started = pools(lambda number: FakeProcess(starts=False), lazy=True)
    assert started == []  # before there is a task
    for _ in range(2):
        with pytest.raises(WorkerEndedError):
            submit(lazy).answer.result(20)


def test_what_waits_when_all_is_closed_is_not_begun(pools):
    pool, (process,) = pools(tries=2)
    running = submit(pool, "wait")
    until(lambda: running.state is TaskState.RUNNING)
    waiting = submit(pool)
    pool.close()
    assert not process.alive
    for task in (running, waiting):
        assert isinstance(task.answer.exception(5), ResourceError)
    assert (waiting.tries, waiting.state) == (0, TaskState.FAILED)
    with pytest.raises(ResourceError, match="being stopped"):
        submit(pool)
