"""Predictions over HTTP for other programs (`lightprobe serve`), and what every server of this project needs."""

from lightprobe.service.server import serve

__all__ = ["serve"]
