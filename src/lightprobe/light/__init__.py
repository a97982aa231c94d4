"""Environment radiance in, prefiltered levels out: cubemaps, equirectangular maps and the prefilter operator."""

from lightprobe.core import first_calls  # noqa: F401  (its import is its work)
