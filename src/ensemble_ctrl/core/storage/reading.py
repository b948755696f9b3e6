"""Reading regular files only: a pipe or a device would keep us waiting, or never end."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

BLOCK = 1_000_000
"""Bytes read at a time: a reader makes room for all that it is asked for."""


class NotRegular(OSError):
    """It is a pipe, a device or a socket."""

    def __init__(self, path: Path) -> None:
        super().__init__(errno.EINVAL, "this is a pipe or a device, not a regular file", str(path))


def read_regular(path: Path, most: int) -> bytes:
    """The first bytes of a regular file, one more than `most` if it has them.

    Raises
    ------
    NotRegular
        If it is something else than a file or a folder.
    OSError
        If it can't be read.
    """
    found = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        mode = os.fstat(found).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise NotRegular(path)
        with open(found, "rb", closefd=False) as file:
            content = bytearray()
            while len(content) <= most and (block := file.read(min(BLOCK, most + 1 - len(content)))):
                content += block
            return bytes(content)
    finally:
        os.close(found)
