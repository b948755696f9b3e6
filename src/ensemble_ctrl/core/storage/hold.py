"""Hidden files and folders that belong to one process as long as it lives, by a lock that ends with it."""

from __future__ import annotations

import os
import re
import shutil
from contextlib import suppress
from pathlib import Path
from secrets import token_hex
from typing import Any

fcntl: Any
try:
    import fcntl
except ImportError:  # a system without such locks: nothing is held, and nothing is swept
    fcntl = None

HIDDEN = re.compile(r"\.ensemble-plan-[0-9a-f]{12}")
"""Names of what is being written; what bears one and is not locked was left by a process that has ended."""
_NO_WAIT = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


def hidden_name() -> str:
    """A name that nobody can foresee."""
    return f".ensemble-plan-{token_hex(6)}"


def hold(path: Path) -> int | None:
    """Lock a file or a folder until the descriptor is closed or the process ends.

    Returns
    -------
    int or None
        The descriptor; None if there are no locks here, or if what was locked is no longer at this path.

    Raises
    ------
    BlockingIOError
        If another process holds it.
    OSError
        If it can't be opened; links are not followed.
    """
    if fcntl is None:
        return None
    held = os.open(path, os.O_RDONLY | _NO_WAIT)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(held), os.lstat(path)):
            return held
    except BlockingIOError:
        os.close(held)
        raise
    except OSError:  # a file system without locks, or the path is gone
        pass
    os.close(held)
    return None


def release(held: int | None) -> None:
    """Give up a lock."""
    if held is not None:
        os.close(held)


def claim(path: Path) -> int | None:
    """Make an empty folder of this name that is held by this process; one that a dead process left is emptied.

    Returns
    -------
    int or None
        The lock; None where there are none, and then nothing is ever taken over.

    Raises
    ------
    BlockingIOError
        If another process holds it.
    """
    while True:
        try:
            path.mkdir()
            made = True
        except FileExistsError:
            made = False
        try:
            held = hold(path)
        except FileNotFoundError:  # it was swept in between
            continue
        if held is not None:
            _empty(path)
            return held
        if made and path.is_dir():
            return None
        if path.is_dir():
            raise BlockingIOError(f"{path} is in use")


def _empty(folder: Path) -> None:
    """Remove what is in a folder."""
    for entry in folder.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def sweep(folder: Path) -> None:
    """Remove what processes that have ended were writing in a folder."""
    with suppress(OSError):
        for entry in list(folder.iterdir()):
            if HIDDEN.fullmatch(entry.name) and not entry.is_symlink():
                with suppress(OSError):
                    _remove_dead(entry)


def _remove_dead(path: Path) -> None:
    """Remove a file or a folder, unless it is held."""
    if not (path.is_dir() or path.is_file()):
        return
    held = hold(path)
    if held is None:
        return
    try:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    finally:
        release(held)
