"""A `Decomposition` in, files other programs read out: GLB, textures and environment maps in the user's own frame."""
