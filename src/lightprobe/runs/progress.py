"""How work that takes long tells how far it is."""

from typing import Protocol


class OnProgress(Protocol):
    """Hears how far a stage of the work is."""

    def __call__(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Take note that `done` of `total` steps of `stage` are finished; `note` is the last one's result."""


def silent(stage: str, done: int, total: int, note: str = "") -> None:
    """Take no note: the `OnProgress` of those who do not ask."""


def clock(seconds: float) -> str:
    """Return a duration as minutes:seconds, from an hour on as hours:minutes:seconds."""
    whole = round(seconds)
    minutes, rest = divmod(whole, 60)
    return f"{minutes}:{rest:02d}" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"
