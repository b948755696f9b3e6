"""The results folder: written whole to a temporary sibling, then renamed, so that nothing half-written is ever seen."""

from __future__ import annotations

import json
import os
import platform
import shutil
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from ensemble_ctrl._version import __version__
from ensemble_ctrl.api import Plan
from ensemble_ctrl.config import dump
from ensemble_ctrl.errors import EnsembleError
from ensemble_ctrl.replay import Replay

SCHEMA = 1
"""Version of ``summary.json`` and of the JSON that the command prints."""
LIBRARIES = ("casadi", "numpy", "pyyaml", "pydantic", "shapely", "matplotlib")


class FolderError(EnsembleError):
    """The results folder can't be used; nothing was changed."""


def default_folder(name: str, root: Path = Path("plans")) -> Path:
    """``plans/<name>``, or the first of ``plans/<name>-2``, ``-3``, ... that does not exist yet."""
    safe = "".join(c if c.isalnum() or c in "._-" else "_" for c in name).strip(".") or "plan"
    folder, n = root / safe, 2
    while folder.exists():
        folder, n = root / f"{safe}-{n}", n + 1
    return folder


class ResultsFolder:
    """A folder to be: files are put into `working`, and `commit` makes it the real one.

    Parameters
    ----------
    target : Path
        Where the results belong; must not exist, or be an empty folder, unless `overwrite`.
    overwrite : bool
        Whether a folder of earlier results may be replaced.

    Raises
    ------
    FolderError
        If the target is a file, is not empty, or can't be written to; said before any solving.
    """

    def __init__(self, target: Path, overwrite: bool = False) -> None:
        self.target = target
        if target.exists() and not target.is_dir():
            raise FolderError(f"{target}: expected a folder for the results, found a file")
        if target.is_dir() and any(target.iterdir()) and not overwrite:
            raise FolderError(f"{target}: this folder is not empty; choose another with -o, or add --overwrite")
        if target.is_dir() and overwrite and any(target.iterdir()) and not (target / "plan.npz").exists():
            raise FolderError(f"{target}: --overwrite replaces only folders of earlier results (no plan.npz in it)")
        try:
            target.absolute().parent.mkdir(parents=True, exist_ok=True)
            prefix = f".{target.name}-"
            self.working = Path(tempfile.mkdtemp(prefix=prefix, dir=target.absolute().parent))
        except OSError as error:
            raise FolderError(f"{target}: can't write results here ({error.strerror})") from None

    def commit(self) -> Path:
        """Put the folder in its place."""
        os.chmod(self.working, 0o755)
        if self.target.is_dir():
            old = Path(tempfile.mkdtemp(prefix=f".{self.target.name}-old-", dir=self.target.absolute().parent))
            os.replace(self.target, old / "results")
            os.replace(self.working, self.target)
            shutil.rmtree(old, ignore_errors=True)
        else:
            os.replace(self.working, self.target)
        return self.target

    def discard(self) -> None:
        """Remove what was written so far."""
        shutil.rmtree(self.working, ignore_errors=True)


def write_results(plan: Plan, folder: Path, command: Sequence[str], figures: bool = True) -> None:
    """Write every file of a plan into `folder`."""
    plan.save(folder / "plan.npz")
    (folder / "controls.csv").write_text(controls_csv(plan), encoding="utf-8")
    (folder / "problem.yaml").write_text(dump(plan.problem), encoding="utf-8")
    _write_json(folder / "summary.json", summary(plan))
    _write_json(folder / "provenance.json", provenance(plan, command))
    if figures:
        from ensemble_ctrl.report.figures import write_figures

        write_figures(plan.problem, plan.controls, folder)


def controls_csv(plan: Plan) -> str:
    """The controls as a table: start of each step and its commands, units in the header."""
    system = plan.problem.fleet.system
    header = ["t [s]", *(f"{n} [{u}]" for n, u in zip(system.controls, system.control_units, strict=True))]
    rows = np.column_stack([plan.times, plan.controls])
    lines = [",".join(header), *(",".join(repr(float(x)) for x in row) for row in rows)]
    return "\n".join(lines) + "\n"


def summary(plan: Plan) -> dict[str, Any]:
    """The plan's facts as plain data, the body of ``summary.json`` and of ``--json``."""
    return {
        "schema": SCHEMA,
        "name": plan.problem.name,
        "status": plan.status,
        "verified": plan.verified,
        "task": str(plan.problem.task),
        "steps": plan.problem.steps,
        "step_seconds": plan.problem.step,
        "replay": None if plan.replayed is None else replay_summary(plan.replayed),
        "conflicts": [vars(c) for c in plan.conflicts()] if not plan.verified else [],
        "details": plan.details,
    }


def replay_summary(run: Replay) -> dict[str, Any]:
    """A replay as plain data."""
    value, parameter = run.worst
    return {
        "members": run.members,
        "substeps": run.substeps,
        "violating": int(run.violating.sum()),
        "satisfied_share": run.satisfied,
        "worst_robustness": {"metres": value, "parameter": parameter},
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
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _write_json(path: Path, data: dict[str, Any]) -> None:
    """Write readable, strict JSON: numbers that JSON lacks become null."""
    path.write_text(to_json(data, indent=2) + "\n", encoding="utf-8")


def to_json(data: Any, indent: int | None = None) -> str:
    """Strict JSON text."""
    return json.dumps(_finite(data), indent=indent, allow_nan=False)


def _finite(data: Any) -> Any:
    """The same data with infinite and undefined numbers as None."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    if isinstance(data, float) and not np.isfinite(data):
        return None
    return data
