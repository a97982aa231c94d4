"""Tasks on a Ray cluster: one on this machine, started for the call, or one that runs already.

Ray decides where a task runs, and starts it again where a process or machine has died. It pickles between its
own nodes, so whoever reaches a cluster's ports can run code there: a cluster must be private. The one that is
started here listens on the loopback address only and takes a token that no one else has. Nothing is reported
anywhere, and there is no dashboard.
"""

import contextlib
import logging
import os
import secrets
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from lightprobe.core.errors import ResourceError
from lightprobe.core.extras import extra_library
from lightprobe.fleet.executor import Needs, Outcome, Result, Task

_OBJECT_STORE = 128 * 2**20  # bytes on this machine: tasks and rows are small, photos and maps go by files
_MEMORY_RETRIES = "3"  # of a task that its machine had no memory for; without it Ray never gives one up
_WAITING = 2  # tasks handed over for each that can run, so that no machine waits for the next one
_SIZE_SECONDS = 5.0  # between two looks at how large the cluster is


@contextlib.contextmanager
def cluster(address: str | None = None) -> Iterator["RayExecutor"]:
    """Yield the executor of a Ray cluster: of the one at `address`, HOST:PORT or `auto`, else of one made
    here.

    Raises `ConfigError` without Ray, `ResourceError` when no cluster answers or none can be started.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # these are read when Ray starts
    os.environ.setdefault("RAY_task_oom_retries", _MEMORY_RETRIES)
    logging.getLogger("ray").setLevel(
        logging.ERROR
    )  # what it says of itself is not for whoever runs a command
    ray = extra_library("ray", "A fleet", "cluster")
    try:
        if address is None:
            os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
            ray.init(
                address="local",
                include_dashboard=False,
                log_to_driver=False,
                configure_logging=False,
                object_store_memory=_OBJECT_STORE,
                _node_ip_address="127.0.0.1",
            )
        else:
            ray.init(address=address, log_to_driver=False, configure_logging=False)
    except Exception as error:  # of many kinds, by what is wrong
        said = str(error).strip().split("\n")[0].rstrip(".") or type(error).__name__
        where = f"The Ray cluster at {address}" if address else "Ray on this machine"
        raise ResourceError(f"{where} does not start or answer: {said}.") from error
    try:
        yield RayExecutor(ray)
    finally:
        ray.shutdown()


class RayExecutor:
    """Runs tasks on the cluster that Ray is connected to; see `executor.Executor`."""

    def __init__(self, ray: Any):
        """Use the module `ray`, after its `init`."""
        self._ray = ray
        self._looked, self._slots = -_SIZE_SECONDS, 1

    def run(
        self, function: Callable[[Task], Result], tasks: Iterable[Task], needs: Needs
    ) -> Iterator[Outcome[Task, Result]]:
        """Yield the outcome of `function` on each task as they finish.

        Only a few tasks more than can run are handed over at a time, so that there may be any number of them.
        Raises `ResourceError` when no machine of the cluster has what a task needs.
        """
        self._check(needs)
        remote = self._ray.remote(
            num_cpus=needs.cpus,
            num_gpus=needs.gpus,
            memory=int(needs.memory * 2**30),
            max_retries=needs.retries,
        )(function)
        waiting: dict[Any, Task] = {}
        coming, more = iter(tasks), True
        while more or waiting:
            while more and len(waiting) < _WAITING * self._fit(needs):
                for task in coming:
                    waiting[remote.remote(task)] = task
                    break
                else:
                    more = False
            if waiting:
                for ready in self._ray.wait(list(waiting), num_returns=1)[0]:
                    yield self._outcome(waiting.pop(ready), ready, needs)

    def _outcome(self, task: Task, ready: Any, needs: Needs) -> Outcome[Task, Result]:
        try:
            return Outcome(task, self._ray.get(ready))
        except self._ray.exceptions.RayError as error:
            return Outcome(task, None, _reason(error, needs))

    def _machines(self) -> list[dict[str, float]]:
        return [node["Resources"] for node in self._ray.nodes() if node["Alive"]]

    def _check(self, needs: Needs) -> None:
        machines = self._machines()
        if not any(_tasks_on(machine, needs) for machine in machines):
            most = max(tuple(one.get(name, 0.0) for name in ("CPU", "GPU", "memory")) for one in machines)
            raise ResourceError(
                f"No machine has what a task needs, {needs.cpus:g} CPUs, {needs.gpus:g} GPUs and {needs.memory:g} GiB; "
                f"the largest has {most[0]:g}, {most[1]:g} and {most[2] / 2**30:.1f}: change --needs."
            )

    def _fit(self, needs: Needs) -> int:
        """Return how many tasks can run at once, at least one; machines may come and go meanwhile."""
        if time.monotonic() - self._looked >= _SIZE_SECONDS:
            self._looked = time.monotonic()
            self._slots = max(1, sum(_tasks_on(machine, needs) for machine in self._machines()))
        return self._slots


def _tasks_on(machine: dict[str, float], needs: Needs) -> int:
    """Return how many tasks a machine with these resources can run at once."""
    wanted = {"CPU": needs.cpus, "GPU": needs.gpus, "memory": needs.memory * 2**30}
    return int(min(machine.get(name, 0.0) // amount for name, amount in wanted.items() if amount > 0))


def _reason(error: Exception, needs: Needs) -> str:
    """Return in a sentence why Ray has given a task up."""
    kind, tries = type(error).__name__, needs.retries + 1
    if "OutOfMemory" in kind:
        return "Its machine ran out of memory, also when it was tried again; give tasks more with --needs.memory."
    if kind.startswith("RayTaskError"):
        cause = str(getattr(error, "cause", error)).strip().split("\n")[-1].rstrip(".")
        return f"The worker could not run it: {cause}; is the same lightprobe installed on every machine?"
    return f"Its process or machine died in {tries} tries ({kind})."
