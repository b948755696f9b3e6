"""Prints the constraints file of the oldest libraries allowed: ``python .ci/minimum.py > .ci/minimum.txt``."""

from __future__ import annotations

import tomllib
from pathlib import Path

PROJECT = Path(__file__).parents[1] / "pyproject.toml"


def constraints() -> str:
    """A line ``name==version`` for each dependency ``name>=version``."""
    declared = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["dependencies"]
    return "".join(f"{entry.replace('>=', '==')}\n" for entry in sorted(declared))


if __name__ == "__main__":
    print(constraints(), end="")
