"""Predictions over HTTP for other programs (`lightprobe serve`)."""

from lightprobe.service.server import serve

__all__ = ["serve"]
