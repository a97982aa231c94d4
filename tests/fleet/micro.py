"""Settings that train a scene in a few steps: what a fleet does with it does not depend on how good it gets."""

from benchmarks.fleet import FEW_STEPS as OPTIONS

__all__ = ["OPTIONS"]
