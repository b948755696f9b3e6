"""What the command prints, as it stands on the pages; times, which differ from run to run, are left out as ``…``."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from printed.table import CONFIGS, FIVE, Rows, Table, config

MINIMUM = "time/minimum_time"
TWO = "two_tractions"
BOX = "--box linear_traction --box angular_traction"
CHANNELS = "channels/two_channels"
HERE = "../docs/printed/too_short"
"""A problem beside this file, and so decided by it, too."""
TIMES = re.compile(r"\d+\.\d+ s\b")
TIME_AT_THE_END = re.compile(r"(?<= \()\d+\.\d+ s(?=\)$)")
"""What the line `work` holds many of, and a proof ends with."""
RING = '{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 2], [4, 1]]]}'
SQUARE = '{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}'
FEATURE = '{"type": "Feature", "properties": {"name": "%s"}, "geometry": %s}'
MISSPELT = """\
fleet: {model: unicicle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 4 s}
task: F x >= 1
"""
YARD = ", ".join(FEATURE % (f"shed {i}", SQUARE if i < 3 else RING) for i in range(4))
FILES: Mapping[str, str | bytes] = {
    "bad.yaml": MISSPELT,
    "too_short.yaml": config(HERE).read_text(encoding="utf-8"),
    "yard.geojson": f'{{"type": "FeatureCollection", "features": [{YARD}]}}',
    "hall_map.yml": "image: office_map.pgm\nresolution: 0\norigin: [0, 0, 0]\n",
    "office_map.yml": "image: office_map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n",
    "office_map.pgm": b"P5\n10 10\n255\n" + bytes(50),
}
"""Files that lie where the commands are run."""


def rows(problems: tuple[str, ...], before: str, commands: tuple[str, ...], begins: tuple[str, ...]) -> Rows:
    """The lines that commands print after another one, those that begin with one of some words."""
    with TemporaryDirectory() as folder:
        for name, content in FILES.items():
            Path(folder, name).write_bytes(content if isinstance(content, bytes) else content.encode())
        if before:
            _run(before, folder)
        printed = [line for command in commands for line in _run(command, folder)]
    return [{"line": _without_times(line)} for line in printed if line.strip().startswith(begins)]


def _without_times(line: str) -> str:
    """A line without the times of the machine; those of a plan stay."""
    return (TIMES if line.strip().startswith("work") else TIME_AT_THE_END).sub("… s", line)


def _run(arguments: str, folder: str) -> list[str]:
    """One command, without the notes of its progress."""
    words = [str(CONFIGS.parent / word) if word.startswith("configs/") else word for word in arguments.split()]
    command = [sys.executable, "-m", "ensemble_ctrl.cli", *words]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NO_COLOR": "1"}
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment)
    return (done.stdout or done.stderr).splitlines()


def lines(found: Rows) -> Iterator[str]:
    """A block of text."""
    yield from ("```text", *(row["line"] for row in found), "```")


def block(page: str, problem: str, *commands: str, before: str = "", begins: tuple[str, ...] = ("",)) -> Table:
    """A block of what commands print; everything of the package decides it."""
    run = partial(rows, before=before, commands=commands, begins=begins)
    return Table(page, (problem,), run, lines, left_out=())


MAPS = ("import yard.geojson", "import hall_map.yml", "import office_map.yml")
TABLES = {
    "front": block(
        "docs/index.md", FIVE, f"configs/{FIVE}.yaml -q --no-plots", begins=(f"{FIVE}:", "replay", "proven")
    ),
    "first": block("docs/install.md", FIVE, "problem.yaml -q", before="init"),
    "misspelt": block("docs/problem_file.md", HERE, "check -q bad.yaml"),
    "too_short": block("docs/command.md", HERE, "too_short.yaml -q", begins=("violated", "it works", "--set", "or ")),
    "widest": block("docs/command.md", FIVE, f"widest configs/{FIVE}.yaml -q"),
    "widest_box": block("docs/fleets.md", f"fleets/{TWO}", f"widest configs/fleets/{TWO}.yaml {BOX} -q"),
    "channels": block("docs/channels.md", CHANNELS, f"channels configs/{CHANNELS}.yaml -q --no-plots"),
    "minimum_time": block("docs/objectives.md", MINIMUM, f"configs/{MINIMUM}.yaml -q", begins=("minimum",)),
    "bad_maps": block("docs/maps.md", HERE, *MAPS),
}
