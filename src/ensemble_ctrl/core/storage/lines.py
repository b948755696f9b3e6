"""A text file that grows by whole lines, held by one process, and that a killed process leaves usable."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

from ensemble_ctrl.core.storage.hold import hold, release
from ensemble_ctrl.core.storage.reading import NotRegular


class Lines:
    """Lines of a file, with the place of each.

    Parameters
    ----------
    path : Path
        A file of lines, or a new name; a link is not followed.

    Raises
    ------
    BlockingIOError
        If another process holds it.
    OSError
        If it can't be written.

    Notes
    -----
    *Guarantee*: a line that was added is there after this process was killed. A half line, of a process that was
    killed while it wrote, is cut off.
    """

    def __init__(self, path: Path) -> None:
        if path.exists() and not path.is_file():
            raise (
                IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
                if path.is_dir()
                else (NotRegular(path))
            )
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
        self._file = open(os.open(path, flags, 0o666), "r+b")  # noqa: SIM115
        try:
            self._held = hold(path)
        except OSError:
            self._file.close()
            raise

    def read(self) -> Iterator[tuple[int, bytes]]:
        """The place of every line, and the line; cuts off a half one at the end."""
        self._file.seek(0)
        place = 0
        for line in self._file:
            if not line.endswith(b"\n"):
                self._file.truncate(place)
                return
            yield place, line
            place += len(line)

    def at(self, place: int) -> bytes:
        """The line at a place."""
        self._file.seek(place)
        return self._file.readline()

    def add(self, line: bytes) -> int:
        """Put a line, without its end, behind the others; returns its place."""
        place = self._file.seek(0, os.SEEK_END)
        self._file.write(line + b"\n")
        self._file.flush()
        return place

    def close(self) -> None:
        """Give up the file."""
        self._file.close()
        release(self._held)
