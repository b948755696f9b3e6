"""``ensemble-plan examples``: the problem files that come with the package."""

from __future__ import annotations

import sys
from importlib.resources import files
from pathlib import Path

from ensemble_ctrl.cli import codes


def example_texts() -> dict[str, str]:
    """Every example's text by its name; from the package, or from ``configs`` beside the sources."""
    packaged = files("ensemble_ctrl") / "configs"
    folder = packaged if packaged.is_dir() else Path(__file__).parents[3] / "configs"
    found = [entry for entry in folder.iterdir() if entry.name.endswith(".yaml")]
    return {entry.name.removesuffix(".yaml"): entry.read_text(encoding="utf-8") for entry in found}


def list_or_print(name: str | None, copy: bool) -> int:
    """List all, print one, or copy one here."""
    texts = example_texts()
    if name is None:
        for key in sorted(texts):
            print(f"{key:<20}{_title(texts[key])}")
        return codes.OK
    if name not in texts:
        return _refuse(f"examples: expected one of {', '.join(sorted(texts))}, got {name!r}")
    if not copy:
        print(texts[name], end="")
        return codes.OK
    target = Path(f"{name}.yaml")
    if target.exists():
        return _refuse(f"{target}: this file exists already; nothing was written")
    target.write_text(texts[name], encoding="utf-8")
    print(f"wrote {target}")
    return codes.OK


def _title(text: str) -> str:
    """The first comment of an example."""
    comments = (line for line in text.splitlines() if line.startswith("# ") and "$schema" not in line)
    return next(comments, "# ").removeprefix("# ")


def _refuse(message: str) -> int:
    """A user's mistake."""
    print(f"error: {message}", file=sys.stderr)
    return codes.USAGE
