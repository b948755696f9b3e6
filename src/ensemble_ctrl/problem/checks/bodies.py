"""Bodies: a start that overlaps an obstacle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.problem.checks.finding import SLACK, Finding

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def body_findings(problem: Problem) -> Iterator[Finding]:
    """Obstacles that the body overlaps at the start, of the middle member or one at a corner of the ranges."""
    fleet, body = problem.fleet, problem.fleet.footprint
    if body is None or not fleet.system.on_arcs:
        return
    starts = fleet.start_states(np.concatenate([fleet.center[None], fleet.corners]))
    places = starts[[fleet.system.states.index(name) for name in fleet.places]].T
    headings = starts[fleet.system.states.index(fleet.system.heading_state)]
    for avoid in problem.specification.avoid:
        if avoid.footprint is None or avoid.begin > 0:
            continue
        seen = places - avoid.offsets(np.zeros(1))[0]
        depth = avoid.radius - min(float(body.distance(piece, seen, headings).min()) for piece in avoid.pieces)
        if depth > SLACK:
            more = f", grown by the radius {fleet.radius:g} m" if fleet.radius else ""
            what = f"the body ({body}{more}) overlaps obstacle {avoid.name!r} by {depth:.3g} m at the start"
            yield Finding(("fleet", "start", "position"), what, "move the start or the obstacle")
