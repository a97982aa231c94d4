"""Signed distances on a tetrahedral lattice in, triangle meshes with texture coordinates out."""
