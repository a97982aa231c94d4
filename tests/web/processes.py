"""Worker processes that are none: what a request is called says what becomes of it."""

import itertools
import threading

from lightprobe.core.errors import InputError
from lightprobe.web.errors import WorkerEndedError
from lightprobe.web.worker import START


class FakeProcess:
    """Answers in this process; "wait" until `go` is set, and "die" once or always."""

    pids = itertools.count(1)

    def __init__(self, number=0, *, starts=True):
        self.pid, self.alive, self.starts = next(self.pids), True, starts
        self.objects, self.go = [], threading.Event()

    def ask(self, request, on_stage):
        if request == START:
            return {"ready": True} if self.starts else self._end()
        on_stage("at work")
        what = request["what"]
        if what == "wait":
            self.go.wait(20)
        if what == "fail":
            raise InputError("This cannot be done.")
        if what == "break":
            raise KeyError("what")
        if what == "die" or (what == "die once" and not request.setdefault("died", False)):
            request["died"] = True
            self._end()
        if not self.alive:
            self._end()
        self.objects.append(request.get("object", ""))
        return {"pid": self.pid, "worker": {"objects": self.objects[-2:]}}

    def kill(self):
        self.alive = False
        self.go.set()

    def _end(self):
        self.kill()
        raise WorkerEndedError("The process has ended.")
