"""A page in the browser for runs: the object under any light, light from a photo, a training, masks."""

from lightprobe.view.server import serve

__all__ = ["serve"]
