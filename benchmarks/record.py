"""Keep what a benchmark measured, with the machine, in ``benchmarks/measured``; the pages are made from these files."""

from __future__ import annotations

import json
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

MEASURED = Path(__file__).parent / "measured"


def record(name: str, rows: list[dict[str, Any]]) -> None:
    """Write ``<name>.json``; ``python docs/make_tables.py --write`` writes the pages."""
    MEASURED.mkdir(exist_ok=True)
    text = json.dumps({"machine": machine(), "rows": rows}, indent=1, sort_keys=True)
    (MEASURED / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def machine() -> str:
    """The processor, and the versions that decide how fast things are."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{cores} cores of {_processor()}, Python {platform.python_version()}, CasADi {version('casadi')}"


def _processor() -> str:
    """The processor's name, as far as the system tells."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text(encoding="utf-8").splitlines() if facts.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
