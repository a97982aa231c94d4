"""The object of a run in other programs, for `compare_renderers`."""
