"""Which processes a test has started and left: the worker that runs it may have others from before."""

from __future__ import annotations

import os
from pathlib import Path


def children() -> set[str]:
    """Processes that this one has started, those that have ended and were not waited for among them; on Linux."""
    found = set()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = stat.read_text().rpartition(")")[2].split()[1]
        except OSError:  # it has ended meanwhile
            continue
        found |= {stat.parent.name} if parent == str(os.getpid()) else set()
    return found
