"""The unconstrained baseline of a problem: the same fleet and goal with nothing in its way, for comparison.

The paper draws each experiment twice: dashed without its obstacles or its bounding region, solid with them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Polyhedron
from ensemble_ctrl.constraints.stl import Always, And, Avoid, Formula, Inside, Not, Or, conjuncts
from ensemble_ctrl.core.values import expect
from ensemble_ctrl.problem import Problem, ReportOptions
from ensemble_ctrl.problem.specification import TaskPart

Floats = NDArray[np.float64]

FAR = 1e4
"""Metres that stand for no bound where it is not known how far members can go."""
ANYWHERE = "anywhere"
"""The region that stands for the whole plane where nothing else is left of the task."""


def unconstrained(problem: Problem) -> Problem:
    """The same problem without what holds the fleet back.

    Parameters
    ----------
    problem : Problem
        With obstacles to avoid (``G avoid(...)``) or regions to stay in from the start to the end (``G in(...)``).

    Returns
    -------
    Problem
        Without obstacles, with every region to stay in widened to more than the fleet can drive, and without
        a certificate or a baseline of its own. Visits, the objective and the fleet are as they were.

    Notes
    -----
    *Guarantee*: none that a plan of the baseline is good for `problem`; that it is not is what the comparison shows.
    A widened region never binds, so it is left out wherever something else remains to be done. Where nothing else
    does, it is the whole task, and its robustness has no weight: it would only draw the fleet to the middle.

    Examples
    --------
    >>> import ensemble_ctrl as ec
    >>> problem = ec.load_text('''
    ... fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
    ... horizon: {duration: 4 s}
    ... regions: {goal: {box: [[1, 2], [-0.5, 0.5]]}, room: {box: [[-1, 3], [-1, 1]]}}
    ... task: F[3, 4] in(goal) and G in(room)
    ... ''')
    >>> str(unconstrained(problem).task)
    'F[3,4] in(goal)'
    """
    bare = expect("problem", problem, Problem).with_(
        verify=replace(problem.verify, certificate=False), report=ReportOptions(), zones={}
    )
    kept = (part for part in problem.specification.parts if not part.limit and not _keeps_throughout(problem, part))
    rest = tuple(part.written for part in kept)
    if rest:
        return bare.with_(task=rest[0] if len(rest) == 1 else And(rest))
    regions = {**problem.regions, ANYWHERE: _anywhere(problem)}
    objective = replace(problem.objective, robustness=0.0)
    return bare.with_(task=Always(Inside(ANYWHERE)), regions=regions, objective=objective)


def _keeps_throughout(problem: Problem, part: TaskPart) -> bool:
    """Whether a part is a stay through the whole horizon."""
    if not isinstance(part.written, Always) or (part.begin, part.end) != (0.0, problem.duration):
        return False
    return all(_keeps_out(leaf) or _keeps_in(leaf) for leaf in conjuncts(part.written.child))


def _keeps_out(leaf: Formula) -> bool:
    """Whether a formula is ``avoid(a)`` or ``not in(a)``."""
    return isinstance(leaf, Avoid) or (isinstance(leaf, Not) and isinstance(leaf.child, Inside))


def _keeps_in(leaf: Formula) -> bool:
    """Whether a formula is ``in(a)`` or ``in(a) or in(b) or ...``."""
    parts = leaf.parts if isinstance(leaf, Or) else (leaf,)
    return all(isinstance(part, Inside) for part in parts)


def _anywhere(problem: Problem) -> Polyhedron:
    """A box around all starts of twice what the fastest member can drive; where that is not known, a large one."""
    fleet = problem.fleet
    if not fleet.system.on_arcs:
        return Polyhedron.box(np.column_stack([fleet.start_place - FAR, fleet.start_place + FAR]))
    # |p(T) - p_0| <= a_max max|v| T, taken twice
    speed = max(abs(fleet.input_lower[0]), abs(fleet.input_upper[0]))
    reach = 2 * float(speed * fleet.fastest[0]) * problem.duration + 1.0
    return Polyhedron.box(
        np.column_stack([fleet.start_place - fleet.shift - reach, fleet.start_place + fleet.shift + reach])
    )
