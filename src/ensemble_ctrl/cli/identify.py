"""``ensemble-plan identify``: parameter ranges and bounds of errors from logs, as a section to paste."""

from __future__ import annotations

import csv
import sys
from collections import defaultdict
from math import ceil, floor, isfinite, log10
from pathlib import Path

import numpy as np

from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.storage.reading import NotRegular, read_regular
from ensemble_ctrl.problem.evaluation.identified import Identified, RobotLog, identify
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

MOST_BYTES = 200_000_000
"""Of a log."""
DIGITS = 4
"""Of the numbers that are printed, rounded outwards."""


def identify_log(path: Path, model: str, wheelbase: float | None, as_json: bool) -> int:
    """Read a log, or standard input where it is called ``-``, and print what explains it."""
    system = _system(model, wheelbase)
    logs = read_log(path, system)
    try:
        found = identify(system, logs)
    except ProblemError as error:
        raise ProblemError(f"{_name(path)}: {str(error).removeprefix('log: ')}") from None
    if as_json:
        data = {
            "schema": SCHEMA,
            "robots": found.robots,
            "linear_traction": list(found.linear),
            "angular_traction": list(found.angular),
            "uncertainty": found.uncertainty.data(),
        }
        say(to_json(data))
    else:
        say("\n".join(_section(found, model, wheelbase)))
    return codes.OK


def _system(model: str, wheelbase: float | None) -> ArcSystem:
    """What turns commands into rates."""
    if model == Bicycle.name:
        return Bicycle() if wheelbase is None else Bicycle(wheelbase=wheelbase)
    if model != Unicycle.name:
        raise UsageError(f"--model: expected unicycle or bicycle, got {model!r}")
    if wheelbase is not None:
        raise UsageError("--wheelbase: expected it for a bicycle only, got it for a unicycle")
    return Unicycle()


def read_log(path: Path, system: ArcSystem) -> dict[str, RobotLog]:
    """The rows of each robot; columns are ``t``, the commands, ``x``, ``y``, ``heading``, and maybe ``robot``.

    Raises
    ------
    ProblemError
        For columns that are missing or in other units, and cells that are no numbers, with their line.
    """
    place = _name(path)
    text = _content(path).decode("utf-8-sig", "replace").splitlines()
    rows = csv.DictReader(text)
    wanted = ["t", *system.controls, "x", "y", "heading"]
    # a header may carry units, as in `v [m/s]`
    names = {(name or "").split("[")[0].strip(): name for name in rows.fieldnames or ()}
    missing = [name for name in wanted if name not in names]
    if missing and not text:
        raise ProblemError(f"{place}:1: expected the columns {', '.join(wanted)}, got an empty file")
    if missing and ";" in text[0]:
        raise ProblemError(f"{place}:1: expected columns separated by commas and a decimal point, got semicolons")
    if missing:
        raise ProblemError(f"{place}:1: expected the columns {', '.join(wanted)}, got none called {missing[0]!r}")
    units = dict(zip(wanted, ("s", *system.control_units, "m", "m", "rad"), strict=True))
    for name in wanted:
        _, bracket, unit = names[name].partition("[")
        if bracket and unit.rstrip(" ]") != units[name]:
            raise ProblemError(f"{place}:1: expected {name} in {units[name]}, got {names[name].strip()!r}")
    by_robot: dict[str, list[list[float]]] = defaultdict(list)
    for row in rows:
        values = [_number(row[names[name]], name, f"{place}:{rows.line_num}") for name in wanted]
        by_robot[row[names["robot"]] if "robot" in names else "the robot"].append(values)
    tables = {name: np.array(values) for name, values in by_robot.items()}
    return {name: RobotLog(table[:, 0], table[:, 1:3], table[:, 3:]) for name, table in tables.items()}


def _name(path: Path) -> str:
    """What messages call a log."""
    return "<stdin>" if str(path) == "-" else str(path)


def _content(path: Path) -> bytes:
    """The bytes of a log."""
    try:
        found = sys.stdin.buffer.read(MOST_BYTES + 1) if str(path) == "-" else read_regular(path, MOST_BYTES)
    except NotRegular as error:
        raise ProblemError(
            f"{path}: expected a log, got none ({error.strerror}); give it as -, standard input"
        ) from None
    except OSError as error:
        raise ProblemError(f"{_name(path)}: expected a log, can't read it ({error.strerror or error})") from None
    if len(found) > MOST_BYTES:
        raise ProblemError(f"{_name(path)}: expected a log of at most {MOST_BYTES // 1_000_000} MB, got more")
    return found


def _number(cell: str | None, name: str, place: str) -> float:
    """A finite number in a column."""
    try:
        value = float(cell or "")
    except ValueError:
        got = "an empty cell" if cell is not None and not cell.strip() else "no cell" if cell is None else repr(cell)
        raise ProblemError(f"{place}: expected a number for {name}, got {got}") from None
    if not isfinite(value):
        raise ProblemError(f"{place}: expected a finite number for {name}, got {cell}")
    return value


def _section(found: Identified, model: str, wheelbase: float | None) -> list[str]:
    """The section to paste; bounds are rounded outwards."""
    low, high = (
        [_rounded(ends[k], way) for ends in (found.linear, found.angular)] for k, way in ((0, floor), (1, ceil))
    )
    errors = found.uncertainty.disturbance
    return [
        f"# {found.robots} robot{'s' * (found.robots != 1)}; no start, and no input_bounds: these are for you to add",
        "fleet:",
        f"  model: {model}",
        *([] if wheelbase is None else [f"  wheelbase: {wheelbase:g} m"]),
        "  parameters:",
        f"    linear_traction: {{range: [{low[0]}, {high[0]}]}}",
        f"    angular_traction: {{range: [{low[1]}, {high[1]}]}}",
        "  uncertainty:",
        f"    disturbance: {{position: {_rounded(errors['position'], ceil)} m/s, "
        f"heading: {_rounded(errors['heading'], ceil)} rad/s}}",
    ]


def _rounded(value: float, way: object) -> str:
    """A number of a few digits, rounded down or up."""
    if not value:
        return "0"
    scale = 10.0 ** (DIGITS - 1 - floor(log10(abs(value))))
    return f"{(floor if way is floor else ceil)(value * scale) / scale:.{DIGITS}g}"
