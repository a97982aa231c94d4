"""Signed distances on a tetrahedral lattice in, triangle meshes with texture coordinates out."""

from lightprobe.core import first_calls  # noqa: F401  (its import is its work)
