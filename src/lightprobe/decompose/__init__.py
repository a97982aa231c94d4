"""Phase I: a `Scene` in, a `Decomposition` out: mesh, textures and one environment per training photo."""
