"""One problem, planned by a worker: what it gives is a row of facts, and the plan itself if that is wanted."""

from __future__ import annotations

import json
import math
from typing import Any

from ensemble_ctrl.api.planning import failure_message, plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.portable import plan_text
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.core.jobs import Content, Unit
from ensemble_ctrl.files.config.portable import problem_of, problem_text
from ensemble_ctrl.problem import Problem

FACTS = (
    "status",
    "found",
    "proven",
    "verified",
    "cost",
    "clearance",
    "robustness",
    "violating",
    "members",
    "duration",
    "iterations",
    "seconds",
    "build_seconds",
    "solve_seconds",
    "proof_seconds",
    "message",
)
"""Columns of a row, in order."""
TIMES = ("seconds", "build_seconds", "solve_seconds", "proof_seconds")
"""Those of them that differ from run to run."""


def unit_of(problem: Problem, name: str, whole: bool = False) -> Unit:
    """A problem as a unit of work; with `whole` it gives the plan too."""
    return Unit(__name__, Content(json.dumps({"whole": whole, "text": problem_text(problem)})), name=name)


def prepare(text: str) -> dict[str, Any]:
    """What a unit is about."""
    found: dict[str, Any] = json.loads(text)
    return found


def run(asked: dict[str, Any], index: int) -> dict[str, Any]:
    """Plan a problem, replay it and prove it.

    Parameters
    ----------
    asked : dict
        ``text`` of the problem, and whether the ``whole`` plan is wanted.
    index : int
        Always 0.

    Returns
    -------
    dict
        ``row``, its columns `FACTS`; and the ``plan``, or None.
    """
    with problem_of(asked["text"]) as problem:
        try:
            found = plan(problem, check=False)
        except EnsembleError as error:
            return {"row": no_row("error", f"{type(error).__name__}: {error}"), "plan": None}
        return {"row": row_of(found), "plan": plan_text(found) if asked["whole"] else None}


def no_row(status: str, message: str) -> dict[str, Any]:
    """The row of a problem that could not be planned."""
    return dict.fromkeys(FACTS) | {"status": status, "found": False, "message": message}


def row_of(found: Plan) -> dict[str, Any]:
    """The facts of a plan: numbers that do not exist are None, metres and seconds otherwise.

    Notes
    -----
    *Guarantee*: ``clearance`` and ``robustness`` are the proven bounds where there is a certificate. Without one they
    are what the replayed members reached, and hold for these alone.
    """
    certificate, replayed, details = found.certificate, found.replayed, found.details
    clearance, robustness = _reached(found)
    return {
        "status": found.status,
        "found": found.status == "planned",
        "proven": None if certificate is None else certificate.proven,
        "verified": found.verified,
        "cost": _number(details.get("cost")),
        "clearance": _number(clearance),
        "robustness": _number(robustness),
        "violating": None if replayed is None else int(replayed.violating.sum()),
        "members": None if replayed is None else replayed.members,
        "duration": found.problem.duration,
        "iterations": details.get("iterations"),
        "seconds": sum(details.get("seconds", {}).values()),
        "build_seconds": details.get("build_seconds"),
        "solve_seconds": details.get("solve_seconds"),
        "proof_seconds": None if certificate is None else certificate.seconds,
        "message": "" if found.verified else failure_message(found),
    }


def _reached(found: Plan) -> tuple[float | None, float | None]:
    """Clearance and robustness: proven, or else seen."""
    if found.certificate is not None:
        return found.certificate.clearance, found.certificate.robustness
    if found.replayed is None:
        return None, None
    return min((c.distance for c in found.replayed.clearances), default=None), found.replayed.worst[0]


def _number(value: float | None) -> float | None:
    """A number that strict JSON has."""
    return None if value is None or not math.isfinite(value) else float(value)
