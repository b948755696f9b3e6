"""Writing a plan in one of the formats, as a whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate, as_data
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.plain import to_json
from ensemble_ctrl.files.config import to_data
from ensemble_ctrl.files.export.members import Members, sampled
from ensemble_ctrl.files.export.table import to_csv
from ensemble_ctrl.files.export.tube import to_geojson
from ensemble_ctrl.files.folder import FolderError, whole_folder, write_text
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

FORMATS = ("csv", "json", "geojson", "rosbag")
MEMBERS = {"csv": 0, "json": 5, "geojson": 0, "rosbag": 5}
"""Members whose trajectories are written, unless another number is given."""
MOST_MEMBERS = 1_000
SCHEMA = 1
"""Version of the JSON's form."""


def export(
    problem: Problem,
    controls: Floats,
    certificate: Certificate | None,
    form: str,
    path: Path | None = None,
    members: int | None = None,
    overwrite: bool = False,
) -> str | None:
    """Write a plan, or return its text where no path is given.

    Parameters
    ----------
    problem : Problem
        Whose plan it is.
    controls : ndarray, shape (steps, n_u)
        Broadcast commands.
    certificate : Certificate or None
        What is proven of them, for JSON.
    form : {"csv", "json", "geojson", "rosbag"}
        What to write.
    path : Path, optional
        A file, or for ``rosbag`` a folder.
    members : int, optional
        Members whose trajectories are written, spread over the ranges of the parameters; as many at each start.
    overwrite : bool
        Whether a file may be replaced, or a folder that holds a bag of an earlier export and nothing else.

    Raises
    ------
    ProblemError
        For an unknown form or a number of members out of range.
    UnsupportedError
        For ``rosbag`` without the library ``rosbags``; for ``geojson`` of a system that has no enclosure.
    FolderError
        If the path is taken or can't be written.
    """
    if form not in FORMATS:
        raise ProblemError(f"format: expected one of {', '.join(FORMATS)}, got {form!r}")
    count = MEMBERS[form] if members is None else members
    starts = len(problem.fleet.starts) or 1
    if not 0 <= count <= MOST_MEMBERS // starts:
        each = f" at each of {starts} starts" if starts > 1 else ""
        raise ProblemError(f"members: expected a number from 0 to {MOST_MEMBERS // starts}{each}, got {count}")
    shown = sampled(problem, controls, count)
    if form == "rosbag":
        _bag(problem, controls, shown, path, overwrite)
        return None
    text = _text(problem, controls, certificate, form, shown)
    if path is None:
        return text
    write_text(path, text, overwrite)
    return None


def _text(problem: Problem, controls: Floats, certificate: Certificate | None, form: str, members: Members) -> str:
    """A plan as text."""
    if form == "csv":
        return to_csv(problem, controls, members)
    data = to_geojson(problem, controls) if form == "geojson" else as_json(problem, controls, certificate, members)
    return to_json(data) + "\n"


def as_json(problem: Problem, controls: Floats, certificate: Certificate | None, members: Members) -> dict[str, Any]:
    """A plan as plain data."""
    system = problem.fleet.system
    starts = [{"start": name} for name in members.starts] or [{}] * len(members.parameters)
    return {
        "schema": SCHEMA,
        "name": problem.name,
        "step": problem.step,
        "times": problem.times.tolist(),
        "controls": {
            "names": list(system.controls),
            "units": list(system.control_units),
            "values": controls.tolist(),
        },
        "members": [
            {**start, "parameters": parameters, **dict(zip(members.states, values.T.tolist(), strict=True))}
            for start, parameters, values in zip(starts, members.parameters, members.values, strict=True)
        ],
        "certificate": None if certificate is None else as_data(certificate),
        "problem": to_data(problem),
    }


def _bag(problem: Problem, controls: Floats, members: Members, path: Path | None, overwrite: bool) -> None:
    """Write a ROS 2 bag beside its place, then move it there."""
    from ensemble_ctrl.files.export.bag import is_own_bag, write_bag

    if path is None:
        raise ProblemError("path: a ROS 2 bag is a folder; say where to write it")
    if os.path.lexists(path) and not (overwrite and is_own_bag(path)):
        other = "choose another name; only a bag that an export wrote, and nothing beside it, is replaced"
        hint = "add --overwrite to replace it" if is_own_bag(path) else other
        raise FolderError(f"{path}: this exists already; {hint}")
    with whole_folder(path) as working:
        write_bag(working, problem, controls, members)
