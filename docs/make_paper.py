"""Run the paper's experiments and the study of orders, and keep what they found: ``python docs/make_paper.py``.

Rows go to ``benchmarks/measured/paper.json`` and ``paper_study.json``, with the machine, and pictures to
``docs/_static/paper``; the page is written from these files. It takes about 12 minutes on two quiet cores. ``--study``
runs the study alone, ``--experiments`` the experiments alone.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import make_tables
from PIL import Image
from printed import ROOT

sys.path.insert(0, str(ROOT))
from benchmarks.record import record

PICTURES = ROOT / "docs" / "_static" / "paper"
COLOURS = 128
"""Of a kept picture."""


def run(name: str, *options: str) -> None:
    """Run the command, and keep its rows and pictures."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "out"
        command = [sys.executable, "-m", "ensemble_ctrl", "paper", *options, "-o", str(folder), "-q"]
        subprocess.run(command, check=True)
        keep(name, folder)


def keep(name: str, folder: Path) -> None:
    """Keep the rows and pictures of a results folder."""
    (found,) = folder.glob("*.json")
    record(name, json.loads(found.read_text(encoding="utf-8"))["rows"])
    PICTURES.mkdir(parents=True, exist_ok=True)
    for picture in folder.glob("*.png"):
        with Image.open(picture) as image:
            image.convert("P", palette=Image.Palette.ADAPTIVE, colors=COLOURS).save(
                PICTURES / picture.name, optimize=True
            )


def main(arguments: list[str]) -> None:
    """Run what is asked for, both if nothing is, and write the page."""
    if "--study" not in arguments:
        run("paper")
    if "--experiments" not in arguments:
        run("paper_study", "--study", "--members", "10000")
    make_tables.main(["--write"])


if __name__ == "__main__":
    main(sys.argv[1:])
