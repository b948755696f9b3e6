"""The one way to write a file: a new one under a hidden name in the same folder, then put in its place."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from ensemble_ctrl.core.storage.hold import hidden_name, hold, release, sweep
from ensemble_ctrl.core.storage.reading import NotRegular


@contextmanager
def whole_file(path: Path, new: bool = False) -> Iterator[IO[bytes]]:
    """A new file that takes the place of `path` once the block has ended without an error.

    Parameters
    ----------
    path : Path
        A new name, or that of a file. A link is replaced, never followed.
    new : bool
        Whether to leave what bears that name alone.

    Yields
    ------
    binary file
        Its ``name`` is a hidden path in the same folder, for programs that write by name.

    Raises
    ------
    FileExistsError
        If it is to be new and is there.
    OSError
        If it can't be written; what was there before is there still. Its ``filename`` is `path`.
    """
    try:
        _check_place(path, new)
        hidden, held = _hidden_beside(path)
        try:
            with open(hidden, "wb", opener=_existing) as file:
                yield file
                file.flush()
            _put(hidden, path, new)
        finally:
            hidden.unlink(missing_ok=True)
            release(held)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None


def put_file(path: Path, content: str | bytes, new: bool = False) -> None:
    """Write a file as a whole or not at all; see `whole_file`."""
    with whole_file(path, new) as file:
        file.write(content if isinstance(content, bytes) else encoded(content))


def open_new(path: Path) -> IO[str]:
    """A new text file that grows in its place, for a log that has to be there after any fault.

    What bore that name is removed first: a link is never followed.
    """
    _check_place(path, new=False)
    path.unlink(missing_ok=True)
    return open(path, "x", encoding="utf-8", errors="backslashreplace", opener=_created)


def encoded(text: str) -> bytes:
    """A text in UTF-8; what that can't hold, as a file's name that is none, is written as an escape."""
    return text.encode("utf-8", "backslashreplace")


def _check_place(path: Path, new: bool) -> None:
    """Refuse folders, devices and pipes; and whatever is there, if the file is to be new."""
    if new and os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise NotRegular(path)


def _hidden_beside(path: Path) -> tuple[Path, int | None]:
    """A new, empty file in the folder of `path`, and its lock; what dead processes left there is removed."""
    sweep(path.parent)
    while True:
        hidden = path.parent / hidden_name()
        os.close(_created(str(hidden), os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        with suppress(BlockingIOError, FileNotFoundError):  # another process took it for one that was left
            held = hold(hidden)
            if hidden.exists():
                return hidden, held
            release(held)


def _created(path: str, flags: int) -> int:
    """Open a new file."""
    return os.open(path, flags | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0), 0o666)


def _existing(path: str, flags: int) -> int:
    """Open a file that is there and no link."""
    return os.open(path, flags & ~os.O_CREAT | getattr(os, "O_NOFOLLOW", 0))


def _put(hidden: Path, path: Path, new: bool) -> None:
    """Give a file its name."""
    if not new:
        os.replace(hidden, path)
        return
    try:
        os.link(hidden, path, follow_symlinks=False)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        os.rename(hidden, path)
