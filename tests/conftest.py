"""Its presence puts the repository's root on the path, so that tests can share `tests.shapes` and `tests.toy_scene`."""
