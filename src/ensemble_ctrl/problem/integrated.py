"""Trajectories of systems that are defined by an ODE alone, with a stated accuracy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import RunawayError
from ensemble_ctrl.systems.integration import Rule, extrapolated, halving_error

if TYPE_CHECKING:
    from ensemble_ctrl.problem.fleet import Fleet

Floats = NDArray[np.float64]

ACCURACY = 1e-8
"""Largest estimated error of any state at any grid time in a replay, relative to its size where that is above 1."""
SURE = 16
"""Steps of integration in one step of control with which a state that is not finite counts as running away."""
MOST_SUBSTEPS = 128
"""Steps of integration in one step of control beyond which a system counts as too stiff."""


def accurate(fleet: Fleet, controls: Floats, members: Floats, step: float) -> Floats:
    """States of members at the ends of all steps, shape (members, steps + 1, n_x), each known to `ACCURACY`.

    Raises
    ------
    RunawayError
        If a state is not finite, or the system is too stiff for the rule.
    """
    # substeps are counted once for these commands and serve every block of members
    key = np.asarray(controls, dtype=float).tobytes(), step
    if (count := fleet.counted.get(key)) is None:
        fleet.counted.clear()
        count = fleet.counted[key] = needed(fleet, controls, step)
    states = integrated(fleet, controls, members, step, count)
    _require_finite(fleet, states, members, step)
    return states


def integrated(
    fleet: Fleet, controls: Floats, members: Floats, step: float, substeps: int, rule: Rule = extrapolated
) -> Floats:
    """States by a given number of steps of a rule, finite or not, shape (members, steps + 1, n_x)."""
    states = np.empty((len(controls) + 1, len(fleet.system.states), len(members)))
    states[0], psi = fleet.start_states(members), fleet.psi(members)
    with np.errstate(all="ignore"):
        # x_{n+1} = flow of (u_n, psi) over one step, all members at once
        for k, command in enumerate(np.asarray(controls, dtype=float)):
            states[k + 1] = fleet.system.flow(states[k], command, psi, step, substeps, rule)
    return states.transpose(2, 0, 1)


def needed(fleet: Fleet, controls: Floats, step: float, accuracy: float = ACCURACY, rule: Rule = extrapolated) -> int:
    """How many steps of a rule a step of control needs, by halving until the estimated error is small enough.

    Notes
    -----
    The error is estimated for the corners of the ranges and the middle, at every grid time.
    """
    members = np.concatenate([fleet.corners, fleet.center[None]])
    if fleet.system.has_exact:
        return 1
    # step halving on the corners and the middle of the ranges, with Richardson's estimate of the finer run's error
    count, coarse = 1, integrated(fleet, controls, members, step, 1, rule)
    while True:
        fine = integrated(fleet, controls, members, step, 2 * count, rule)
        with np.errstate(all="ignore"):
            error = np.abs(halving_error(rule, coarse, fine)) / np.maximum(1.0, np.abs(fine))
        if np.isfinite(error).all() and error.max() <= accuracy:
            return 2 * count
        if 2 * count >= SURE and not np.isfinite(coarse).all():
            _require_finite(fleet, fine, members, step)
        if 2 * count >= MOST_SUBSTEPS:
            _require_finite(fleet, fine, members, step)
            member, k, state = np.unravel_index(int(error.argmax()), error.shape)
            rule_text = f"{MOST_SUBSTEPS} steps of integration in each step of {step:g} s"
            what = f"too stiff: {fleet.system.states[state]} is known to {error.max():.2g} only with {rule_text}"
            raise _runaway(fleet, f"{what}, not to {accuracy:g},", members[member], int(k), step)
        count, coarse = 2 * count, fine


def _require_finite(fleet: Fleet, states: Floats, members: Floats, step: float) -> None:
    """Refuse trajectories that run away or turn into NaN."""
    # the first member and time with a state that is not finite
    bad = ~np.isfinite(states)
    if bad.any():
        member, k, state = np.argwhere(bad)[0]
        raise _runaway(fleet, f"{fleet.system.states[state]} leaves all bounds", members[member], int(k), step)


def _runaway(fleet: Fleet, what: str, member: Floats, k: int, step: float) -> RunawayError:
    """What happens to a member at a grid time, as an error."""
    parameters = fleet.named(member)
    known = ", ".join(f"{n} = {v:g}" for n, v in parameters.items()) or "every member"
    text = f"{what} at t = {k * step:.4g} s for {known}"
    return RunawayError(f"{fleet.system.name}: {text}", text, parameters, k * step)
