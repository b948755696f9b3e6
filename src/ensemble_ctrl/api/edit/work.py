"""What a planner process does for an editor: plan a problem, first from the last plan, then as the command does.

A unit of work of `core.jobs`: ``index`` 0 continues the last proven plan, 1 plans from nothing, 2 looks for what would
help.  A newer problem is noticed at every iteration: a number in a file that the editor writes says up to which ticket
the work is out of date.
"""

from __future__ import annotations

import json
import mmap
import struct
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from ensemble_ctrl.api.edit.drawing import drawing
from ensemble_ctrl.api.planning import failure_message, judged, plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config.portable import problem_of
from ensemble_ctrl.planning.planner.continuation import continued
from ensemble_ctrl.planning.suggest import SECONDS, suggest
from ensemble_ctrl.problem import Problem

CONTINUED, WHOLE, SUGGESTED = range(3)
"""Indices of the units."""
NUMBER = struct.Struct("<Q")
"""How the last ticket that is out of date is written."""


class SupersededError(EnsembleError):
    """A newer problem is there."""


def prepare(text: str) -> dict[str, Any]:
    """What a unit is about."""
    found: dict[str, Any] = json.loads(text)
    return found


def run(asked: dict[str, Any], index: int) -> dict[str, Any] | None:
    """One stage.

    Parameters
    ----------
    asked : dict
        ``problem`` as text, ``guess`` (controls of the last proven plan, or None), ``ticket``, and the ``stop`` file.
    index : int
        `CONTINUED`, `WHOLE` or `SUGGESTED`.

    Returns
    -------
    dict or None
        The ``drawing`` and the ``controls`` of a plan; what ``helps``; an ``error`` in words; or None where the last
        plan leads to no proven one.
    """
    with problem_of(asked["problem"]) as problem, open(asked["stop"], "rb") as file:
        stop = mmap.mmap(file.fileno(), NUMBER.size, access=mmap.ACCESS_READ)

        def progress(_: str, __: Any) -> bool:
            if NUMBER.unpack(stop[: NUMBER.size])[0] >= asked["ticket"]:
                raise SupersededError("a newer problem is there")
            return False

        try:
            return _STAGES[index](asked, problem, progress)
        except SupersededError:
            raise
        except EnsembleError as error:
            return {"error": str(error)}
        finally:
            stop.close()


def _continued(asked: dict[str, Any], problem: Problem, progress: Any) -> dict[str, Any] | None:
    """From the last proven plan; None where that leads to no proven one, or the problem's program is another."""
    controls = np.array(asked["guess"] or [], dtype=float)
    plain = problem.fleet.system.transcription == "positions" and problem.solve.method == "nlp"
    plain = plain and problem.objective.earliest is None and problem.objective.tolerance is None
    fits = controls.ndim == 2 and controls.shape[1] == len(problem.fleet.system.controls)
    if not plain or not fits or problem.solve.as_published or not isinstance(problem.duration, float):
        return None
    began = perf_counter()
    found = judged(continued(problem, controls, progress=progress), None, began, progress)
    return _drawn(found, began) if found.verified and _proven(found) else None


def _whole(asked: dict[str, Any], problem: Problem, progress: Any) -> dict[str, Any]:
    """As the command plans it."""
    began = perf_counter()
    asked["found"] = found = plan(problem, progress=progress, check=False)
    return _drawn(found, began) | ({} if found.verified else {"why": failure_message(found)})


def _suggested(asked: dict[str, Any], problem: Problem, progress: Any) -> dict[str, Any]:
    """What would help, for `SECONDS` at most."""
    found = asked.get("found")
    controls = plan(problem, progress=progress, check=False).controls if found is None else found.controls
    tried = suggest(problem, controls, seconds=SECONDS, progress=progress)
    helps = [{"change": one.change, "set": list(one.overrides)} for one in tried.helps]
    return {"helps": helps, "failed": list(tried.failed), "limited": tried.limited}


def _drawn(found: Plan, began: float) -> dict[str, Any]:
    """A plan with its drawing."""
    shown = drawing(found)
    return {"drawing": shown, "controls": found.controls.tolist(), "seconds": perf_counter() - began}


def _proven(found: Plan) -> bool:
    """Whether it is proven for every member."""
    return found.certificate is not None and found.certificate.proven == "yes"


_STAGES: tuple[Callable[[dict[str, Any], Problem, Any], dict[str, Any] | None], ...] = (_continued, _whole, _suggested)
