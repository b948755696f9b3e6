r"""Robots that are late: all commands of a robot by the same unknown time, from zero to `fleet.uncertainty.delay`.

Let `q` be the robot's *undelayed self*, which carries each command out when it was meant: with a delay
:math:`\delta \in [0, \Delta]` the robot is at ``p(t) = q(t - delta)``. Whatever `q` does in seconds of its own, errors
and terrain included, it does under the commands as they were sent; so everything that is known of a robot is kept for
`q`, and only what is seen, and what is hit, is at the time of the clock:

- a pose that was measured at `t` is that of `q` somewhere in ``[t - Delta, t]`` (`behind`);
- the robot is within ``int_{t - Delta}^t |q'|`` of ``q(t)`` (`lags`).

Before its first command a robot stands.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.planning.online.propagation import Commands
from ensemble_ctrl.planning.online.slips import UP

Floats = NDArray[np.float64]


def behind(commands: Commands, delay: float, most: tuple[float, float], time: float) -> tuple[float, float, float]:
    """A time of the undelayed self's own, and how far its pose may be from that of the robot at a time.

    Parameters
    ----------
    commands : Commands
    delay : float
        The longest, seconds.
    most : tuple of float
        Largest factors on speed and turn rate at any time.
    time : float
        On the clock, seconds.

    Returns
    -------
    own, turn, away : float
        Seconds, radians and metres.
    """
    if not delay:
        return time, 0.0, 0.0
    # the middle of [t - Delta, t], and what may be driven from there to both of its ends
    own, (a, b), slips = max(time - delay / 2, 0.0), most, commands.slips
    since, until = np.full(2, own), np.array([max(time - delay, 0.0), time])
    span = np.array([own - (time - delay), time - own])
    way, turn = commands.driven(since, until)
    slipped, swerved = commands.slipped(since, until)
    jumps, jumps_of_turn = commands.jumps(since, until)
    strayed, swayed = commands.grounds(since, until)
    away = a * (way + slipped + jumps) + slips.place * span + strayed
    heading = b * (turn + jumps_of_turn) + slips.turned(np.full(2, b), swerved, span, b) + swayed
    return own, float(heading.max()) + UP, float(away.max()) + UP


def lags(commands: Commands, delay: float, most: tuple[float, float], begin: int, steps: int) -> Floats:
    """Metres by which a robot may be from its undelayed self in each of some steps, from the grid time `begin` on."""
    if not delay:
        return np.zeros(steps)
    a, step = most[0], commands.step
    # int over [t - Delta, t] is linear in t between grid times and those a delay later
    grid: Floats = np.asarray(step * np.arange(begin, begin + steps + 1), dtype=float)
    breaks = grid[:-1] + (delay % step)
    jumps, _ = commands.jumps(np.maximum(grid[:-1] - delay, 0.0), grid[1:])

    def over(times: Floats) -> Floats:
        """The bound for one time of the clock, without jumps and pushes."""
        since = np.maximum(times - delay, 0.0)
        slipped, strayed = commands.slipped(since, times)[0], commands.grounds(since, times)[0]
        return np.asarray(a * (commands.driven(since, times)[0] + slipped) + strayed)

    ends = np.maximum(over(grid)[:-1], over(grid)[1:])
    return np.asarray(np.maximum(ends, over(breaks)) + a * jumps + commands.slips.place * delay + UP)
