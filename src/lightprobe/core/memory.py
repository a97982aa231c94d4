"""How much memory the process has used."""

import sys


def peak_memory() -> float | None:
    """Return the largest resident size of this process so far in GiB, or None on systems that do not count it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30
