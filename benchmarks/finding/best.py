"""The best cost that is known for each problem, in a file that only improves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from .case import HERE

BEST = HERE / "best.json"

Record = dict[str, dict[str, Any]]


def read(path: Path = BEST) -> Record:
    """By the name of the problem: its digest, the cost, and what found it."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def improved(record: Record, name: str, digest: str, cost: float, by: str) -> Record:
    """The record with a proven plan's cost, where that is better or the record is of another problem.

    Examples
    --------
    >>> record = improved({}, "mazes-00", "a1", 2.0, "known plan")
    >>> improved(record, "mazes-00", "a1", 3.0, "planner") == record
    True
    >>> improved(record, "mazes-00", "a1", 1.0, "planner")["mazes-00"]["cost"]
    1.0
    """
    known = record.get(name)
    if known is not None and known["problem"] == digest and known["cost"] <= cost:
        return record
    return {**record, name: {"problem": digest, "cost": cost, "by": by}}


def write(record: Record, path: Path = BEST) -> None:
    """Keep a record; what the file has come to know meanwhile stays where it is better."""
    there = read(path)
    for name, found in record.items():
        there = improved(there, name, found["problem"], found["cost"], found["by"])
    text = json.dumps(there, indent=1, sort_keys=True) + "\n"
    part = path.with_suffix(".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
