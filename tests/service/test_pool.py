"""Who takes which request."""

import threading
from collections import deque
from types import SimpleNamespace

from lightprobe.service.pool import Pool


class Told(threading.Condition):
    """A condition that counts how often all who wait for it are woken."""

    times = 0

    def notify_all(self):
        self.times += 1
        super().notify_all()


class IdleSlot:
    alive, number, state, idle_since = True, 0, None, 0.0
    objects = frozenset({"cup"})


def test_who_takes_a_request_wakes_those_who_left_it_to_them():
    """Another idle worker that saw the cup's request first went to sleep, as it belongs to this one."""
    pool, slot = object.__new__(Pool), IdleSlot()
    pool._changed, pool._closed, pool._running, pool.slots = Told(), False, {}, [slot]
    pool._waiting = deque(SimpleNamespace(object=name, tries=0, passed=0) for name in ("cup", "vase"))
    assert pool._next(slot).object == "cup"
    assert pool._changed.times == 2  # that it is idle, and that the vase is left
    assert [task.object for task in pool._waiting] == ["vase"]
