"""A kind of unit for tests: its content is the name of a function here, with a folder for those that leave traces."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

KIND = __name__


def prepare(text: str) -> tuple[str, Path]:
    name, _, folder = text.partition(" ")
    return name, Path(folder)


def run(prepared: tuple[str, Path], index: int) -> Any:
    name, folder = prepared
    return globals()[name](index, folder)


def square(index: int, folder: Path) -> int:
    return index**2


def printed(index: int, folder: Path) -> int:
    os.write(1, b"what a library prints\n")
    return index


def third_raises(index: int, folder: Path) -> int:
    if index == 3:
        raise ValueError("three")
    return index


def third_is_deadly(index: int, folder: Path) -> int:
    """Counts in a file how often it was tried."""
    if index == 3:
        with (folder / "tried").open("a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return index


def deadly_once(index: int, folder: Path) -> int:
    mark = folder / f"seen{index}"
    if index % 3 == 0 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return index


def counted(index: int, folder: Path) -> int:
    """Leaves a mark for each time it is computed."""
    with (folder / f"unit{index}").open("a") as file:
        file.write("x")
    time.sleep(0.02)
    return index


def slow(index: int, folder: Path) -> int:
    (folder / f"pid{os.getpid()}").touch()
    time.sleep(60 if index else 0)
    return index


def large(index: int, folder: Path) -> int:
    """The process it runs in, after it took more than a worker may keep."""
    block = bytearray(1_200_000_000 if index == 0 else 1)
    block[:: 1 << 12] = b"x" * len(block[:: 1 << 12])
    return os.getpid()


def undefined(index: int, folder: Path) -> float:
    return float("nan")


def child_of(index: int, folder: Path) -> dict[str, Any]:
    return {"pid": os.getpid(), "threads": os.environ["OMP_NUM_THREADS"]}


def second_is_slow(index: int, folder: Path) -> int:
    """The process it runs in, at once or never."""
    with (folder / f"unit{index}").open("a") as file:
        file.write("x")
    time.sleep(60 if index == 1 else 0)
    return os.getpid()
