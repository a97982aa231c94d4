"""A run in an object store: brought here to be trained, and what changes sent back while it is.

A training writes each file whole, checkpoints before what marks a phase as finished. Files are sent in the
order in which they were written, and removed ones go last, so that whatever has arrived when a machine dies
is a state that the training had, but for a checkpoint of which only a part came: that one is passed over for
the one before it. One that took another's place, as at the beginning of a pass, first loses the file that it
cannot be read without.
"""

import os
import time
from pathlib import Path

from lightprobe.core.checkpoint import STATE
from lightprobe.fleet.storage import Place
from lightprobe.preparation import HIDDEN

_LEFT_OUT = ("predictions/", "report/", "oracle/")


class Mirror:
    """A run's folder here and in an object store."""

    def __init__(self, folder: Path, remote: Place, every: float = 60.0):
        """Bring what there is of the run at `remote` into `folder`.

        every: seconds between two looks for changed files, the most that a dead machine costs beside a
        checkpoint's steps.
        """
        self.folder, self._remote, self._every = folder, remote, every
        if remote.files():
            remote.fetch_folder(folder, _LEFT_OUT)
        self._sent = self._stamps()
        self._last = time.monotonic()

    def on_progress(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Send what has changed, now and then; an `OnProgress`."""
        if time.monotonic() - self._last >= self._every:
            self.send()

    def send(self) -> None:
        """Send all files that are new or have changed, in the order of writing; then remove what is gone."""
        now = self._stamps()
        changed = [name for name in now if self._sent.get(name) != now[name]]
        for name in changed:
            if name in self._sent and name.endswith(f"/{STATE}"):
                self._remote.child(*name.split("/")).remove()
        for name in sorted(changed, key=lambda name: (now[name][0], name)):
            self._remote.child(*name.split("/")).write((self.folder / name).read_bytes())
        for name in self._sent.keys() - now.keys():
            self._remote.child(*name.split("/")).remove()
        self._sent, self._last = now, time.monotonic()

    def _stamps(self) -> dict[str, tuple[int, int]]:
        """Return time of writing and size of every file, by its path in the folder.

        Hidden ones are this machine's own, but for what `prepare` keeps of a scene to go on from.
        """
        found: dict[str, tuple[int, int]] = {}
        for parent, folders, files in os.walk(self.folder):
            folders[:] = [name for name in folders if not name.startswith(".") or name == HIDDEN]
            for file in files:
                path = Path(parent, file)
                if not file.startswith("."):
                    stat = path.stat()
                    found[path.relative_to(self.folder).as_posix()] = (stat.st_mtime_ns, stat.st_size)
        return found
