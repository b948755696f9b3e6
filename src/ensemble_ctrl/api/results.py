"""What a run leaves behind: the files of a results folder, and the facts in them as plain data."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import as_data, claim
from ensemble_ctrl.core.plain import to_json as to_json
from ensemble_ctrl.core.storage import put_file, read_regular
from ensemble_ctrl.core.version import __version__
from ensemble_ctrl.files.config import dump, to_data
from ensemble_ctrl.files.config.system_section import source_file
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.conflicts import unit_of_task
from ensemble_ctrl.problem.evaluation.sampled import Replay
from ensemble_ctrl.problem.plain import proven_part

SCHEMA = 1
"""Version of ``summary.json`` and of the JSON that the command prints."""
MOST_LOG = 50_000_000
"""Bytes of a solver's log that are read."""
LIBRARIES = ("casadi", "numpy", "scipy", "shapely", "pydantic", "pyyaml", "typer", "matplotlib")


def write_results(plan: Plan, folder: Path, command: Sequence[str]) -> None:
    """Write every file of a plan into `folder`, except the figures and the report."""
    plan.save(folder / "plan.npz")
    put_file(folder / "controls.csv", controls_csv(plan))
    put_file(folder / "problem.yaml", dump(plan.problem))
    if source := source_file(plan.problem.fleet.system):
        put_file(folder / source.name, source.read_bytes())
    if plan.certificate is not None:
        _write_json(folder / "certificate.json", claim(plan.certificate))
        put_file(folder / "proof_input.json", to_json(proof_input(plan)) + "\n")
    _write_json(folder / "summary.json", summary(plan))
    _write_json(folder / "provenance.json", provenance(plan, command))


def proof_input(plan: Plan) -> dict[str, Any]:
    """What the certificate is about, for `python -m ensemble_ctrl.certificate`."""
    part = proven_part(to_data(plan.problem))
    part["horizon"] = {"duration": float(plan.problem.duration), "steps": int(plan.problem.steps)}
    return {"problem": part, "controls": plan.controls.tolist()}


def write_report(plan: Plan, path: Path, folder: Path) -> Path:
    """Write a plan's page; where it comes from and how the solver converged are read from its results folder.

    Parameters
    ----------
    plan : Plan
        Replayed, and certified if its problem requires that.
    path : Path
        The file to write, whole or not at all.
    folder : Path
        Where ``provenance.json`` and ``solver.log`` may be.

    Returns
    -------
    Path
        The file.
    """
    from ensemble_ctrl.report.html import report_html

    def text(name: str) -> str:
        try:
            return read_regular(folder / name, MOST_LOG).decode("utf-8", "replace")
        except OSError:
            return ""

    try:
        facts = json.loads(text("provenance.json") or "{}")
    except ValueError:
        facts = {}
    facts = facts if isinstance(facts, dict) else {}
    page = report_html(plan, dump(plan.problem), facts, text("solver.log"))
    put_file(path, page)
    return path


def controls_csv(plan: Plan) -> str:
    """The controls as a table: start of each step in whole nanoseconds and its commands, units in the header."""
    system = plan.problem.fleet.system
    header = ["t [s]", *(f"{n} [{u}]" for n, u in zip(system.controls, system.control_units, strict=True))]
    rows = np.column_stack([plan.times.round(9), plan.controls])
    lines = [",".join(header), *(",".join(repr(float(x)) for x in row) for row in rows)]
    return "\n".join(lines) + "\n"


def summary(plan: Plan) -> dict[str, Any]:
    """The plan's facts as plain data, the body of ``summary.json`` and of ``--json``."""
    return {
        "schema": SCHEMA,
        **planned(plan.problem),
        "status": plan.status,
        "verified": plan.verified,
        "certificate": None if plan.certificate is None else as_data(plan.certificate),
        "replay": None if plan.replayed is None else replay_summary(plan.replayed, unit_of_task(plan.problem)),
        "conflicts": [vars(c) for c in plan.conflicts()] if not plan.verified else [],
        "details": plan.details,
    }


def planned(problem: Problem) -> dict[str, Any]:
    """What was planned, as plain data."""
    return {
        "name": problem.name,
        "task": str(problem.task),
        "steps": problem.steps,
        "step_seconds": problem.step,
    }


def replay_summary(run: Replay, unit: str) -> dict[str, Any]:
    """A replay as plain data; the robustness of a task that is not in metres has its unit in words."""
    value, worst = run.worst
    robustness = {"metres": value} if unit == "m" else {"value": value, "unit": unit}
    return {
        "members": run.members,
        "substeps": run.substeps,
        "disturbed": run.disturbed,
        "violating": int(run.violating.sum()),
        "satisfied_share": run.satisfied,
        "share_95": list(run.share()),
        "shares": [vars(share) for share in run.shares],
        "worst_robustness": robustness | {"parameters": worst},
        "clearances": [vars(c) for c in run.clearances],
        "seconds": run.seconds,
    }


def provenance(plan: Plan, command: Sequence[str]) -> dict[str, Any]:
    """Versions, seed and command: what it takes to run this again."""
    return {
        "ensemble_ctrl": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "libraries": {name: installed_version(name) for name in LIBRARIES},
        "seed": plan.problem.solve.seed,
        "command": list(command),
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def installed_version(name: str) -> str | None:
    """An installed version, if any."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _write_json(path: Path, data: dict[str, Any]) -> None:
    """Write readable, strict JSON: numbers that JSON lacks become null."""
    put_file(path, to_json(data, indent=2) + "\n")
