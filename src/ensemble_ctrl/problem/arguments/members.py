"""Whether a system's equations can be evaluated for the members of a fleet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.problem.arguments.fleets import per_control

if TYPE_CHECKING:
    from ensemble_ctrl.problem.fleet import Fleet


def check_members(fleet: Fleet) -> None:
    """Check that the system takes every corner of the ranges and the middle, with finite rates at the start.

    Raises
    ------
    ProblemError
        With the member that it does not take, or of which a rate is not finite.
    """
    system = fleet.system
    rest: Sequence[float] = ()
    for member in (*fleet.corners, fleet.center):
        psi = {name: float(value[0]) for name, value in fleet.psi(member[None]).items()}
        system.check(psi)
        rest = system.rest(psi)
    command = per_control(system, "system.rest", rest)
    members = np.concatenate([fleet.corners, fleet.center[None]])
    what = f"{type(system).__name__}.xdot"
    try:
        with np.errstate(all="ignore"):
            rates = system.derivatives(fleet.start_states(members), command, fleet.psi(members))
    except ProblemError:
        raise
    except (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError) as error:
        raise ProblemError(f"{what} can't be evaluated: {type(error).__name__}: {error}") from error
    bad = np.argwhere(~np.isfinite(rates))
    if len(bad):
        state, member = bad[0]
        given = ", ".join(f"{n} = {v:g}" for n, v in fleet.named(members[member]).items()) or "every member"
        found = f"{rates[state, member]} for {system.states[state]} ({given})"
        raise ProblemError(f"{what}: expected finite rates at the start, got {found}")
