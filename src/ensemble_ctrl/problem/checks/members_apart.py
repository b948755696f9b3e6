"""Members of different starts that keep apart: where that can't be asked, and starts that are too close."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.constraints.stl import Apart, conjuncts, leaves
from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.starts import keeps_apart

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def members_apart_findings(problem: Problem) -> Iterator[Finding]:
    """What ``apart(...)`` can't be asked of, or in."""
    task = problem.task
    asked = [leaf for leaf in leaves(task) if isinstance(leaf, Apart)]
    taken = {id(leaf) for part in conjuncts(task) if keeps_apart(part) for leaf in part.parts}
    for leaf in asked:
        place = leaf.column - 1 if leaf.column else None
        if not problem.fleet.starts:
            message = f"{leaf} is about members of different starts, and all start at one place"
            yield Finding(("task",), message, "give fleet.starts", offset=place)
        elif id(leaf) not in taken:
            hint = f"write  G {leaf}  or  G[a,b] {leaf}  as a part of the task of its own"
            yield Finding(("task",), f"{leaf} within another part of the task is not supported", hint, offset=place)
        elif problem.uncertain:
            message = f"{leaf} is not supported for robots with errors of the model (fleet.uncertainty, terrain)"
            yield Finding(("task",), message, offset=place)
    if asked and all(keeps_apart(part) for part in conjuncts(task)):
        yield Finding(("task",), "expected more than apart(...): it needs no command, for who stands keeps apart")


def too_close(problem: Problem) -> Iterator[Finding]:
    """Starts that are closer to each other than members of different starts may be, from the beginning."""
    offsets = list(problem.fleet.starts.items())
    for part in problem.specification.apart:
        for k, (name, place) in enumerate(offsets):
            for other, there in offsets[:k]:
                away = float(np.linalg.norm(np.subtract(place, there)))
                if part.begin <= 0 and away < part.distance - SLACK:
                    message = f"this is {away:.3g} m from {other} at the start, and the task wants {part}"
                    yield Finding(("fleet", "starts", name), message, "move them further from each other")
