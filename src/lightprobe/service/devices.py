"""Which worker computes where: CPU workers by their number, of several GPUs one worker for each."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

from lightprobe.core.errors import ConfigError

CPU = "cpu"


@dataclass(frozen=True)
class Assignment:
    """Where a worker computes, and with how many threads."""

    device: str
    threads: int

    @property
    def environment(self) -> dict[str, str]:
        """What the worker's environment needs to say of it.

        Threads that spin while they wait would take the cores of the workers beside them; those of OpenBLAS, NumPy's
        linear algebra, cannot be told not to.
        """
        names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS")
        threads = dict.fromkeys(names, str(self.threads))
        return {**threads, "OPENBLAS_NUM_THREADS": "1", "OMP_WAIT_POLICY": "passive"}


def assignments(
    devices: Sequence[str], workers: int | None, cores: int | None = None
) -> tuple[Assignment, ...]:
    """Return where each worker computes.

    devices: "cpu", or GPUs such as "cuda:0", each named once. workers: by default one for each two cores, at
    least one; of GPUs one each. The cores, by default all that this process may use, are shared out among the
    workers. Raises `ConfigError` where these do not fit each other.
    """
    names = tuple(devices) or (CPU,)
    if workers is not None and workers < 1:
        raise ConfigError(f"--workers {workers} computes nothing; give 1 or more.")
    if len(set(names)) < len(names):
        raise ConfigError(
            "--devices names a device twice; each GPU gets one worker, CPU workers come with --workers."
        )
    available = cores or usable_cores()
    if names == (CPU,):
        names = (CPU,) * (workers or max(available // 2, 1))
    elif workers is not None and workers != len(names):
        raise ConfigError(
            f"--workers {workers} does not fit {len(names)} devices: each of them gets one worker; leave it out."
        )
    return tuple(Assignment(name, max(available // len(names), 1)) for name in names)


def usable_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
