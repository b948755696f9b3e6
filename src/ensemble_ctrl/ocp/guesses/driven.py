"""How a curve becomes commands: the nominal robot drives it pose by pose, forwards or backwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.guesses.slowed import slowed
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

BACK = 0.5
"""Part of what a robot is off its curve that it makes good in a step."""
AHEAD = 3.0
"""Steps ahead at which a robot beside its curve aims."""


def tightest(problem: Problem) -> float:
    """Smallest radius of the nominal robot's turns at half its top speed, to either side, metres."""
    fleet = problem.fleet
    linear, angular = fleet.coefficients(fleet.center[None])[0, :2].tolist()
    fast = 0.5 * float(np.abs([fleet.input_lower[0], fleet.input_upper[0]]).max())
    # |a v| / |b omega| for the largest turn rate to either side, the larger radius of both
    turns = [fleet.arcs.commands(fast, side, fleet.input_lower, fleet.input_upper) for side in (-1e6, 1e6)]
    rates = np.array([fleet.arcs.rates(*commands) for commands in turns])
    return float(np.max(np.abs(rates[:, 0] * linear) / np.maximum(np.abs(rates[:, 1] * angular), 1e-9)))


def reverses(problem: Problem) -> bool:
    """Whether the robots may drive backwards."""
    return bool(problem.fleet.input_lower[0] < 0)


def needed(problem: Problem, poses: Floats) -> Floats:
    """Seconds that the nominal robot needs at least from each pose to the next, shape (poses - 1,)."""
    fleet = problem.fleet
    moved, turned = _moves(poses)
    linear, angular = np.abs(fleet.coefficients(fleet.center[None])[0, :2])
    # |way| / speed, and |turn| / rate where robots turn in place, whichever takes longer
    speeds = np.where(moved < 0, -fleet.input_lower[0], fleet.input_upper[0]) * linear
    seconds = np.abs(moved) / np.maximum(speeds, 1e-3)
    if fleet.arcs.turns_in_place:
        rate = float(np.minimum(np.abs(fleet.input_lower[1]), np.abs(fleet.input_upper[1])))
        seconds = np.maximum(seconds, np.abs(turned) / max(rate * angular, 1e-3))
    return np.asarray(seconds)


def turning(problem: Problem, angle: float) -> float:
    """Seconds that the nominal robot needs at least to turn by an angle in radians where it stands; 0 if it can't."""
    fleet = problem.fleet
    if not fleet.arcs.turns_in_place:
        return 0.0
    angular = abs(float(fleet.coefficients(fleet.center[None])[0, 1]))
    rate = float(np.minimum(np.abs(fleet.input_lower[1]), np.abs(fleet.input_upper[1])))
    return abs(angle) / max(rate * angular, 1e-3)


def driven(problem: Problem, poses: Floats, times: Floats, steps: int) -> Floats:
    """Commands that bring the nominal robot to poses at some times, and back to them where a step was too coarse.

    Parameters
    ----------
    problem : Problem
    poses : ndarray, shape (poses, 3)
        Position in metres, heading in radians from +x.
    times : ndarray, shape (poses,)
        Seconds, increasing.
    steps : int
        Of the commands.

    Returns
    -------
    ndarray, shape (steps, 2)
        Within the input bounds.
    """
    fleet, step = problem.fleet, problem.duration / steps
    times = slowed(problem, poses[:, :2], times)
    linear, angular = fleet.coefficients(fleet.center[None])[0, :2].tolist()
    sign = 1.0 if fleet.arcs.heading_from == "x" else -1.0
    grid = np.linspace(0.0, problem.duration, steps + 1)
    # way and turn as functions of time: their differences over each step, and the pose at its begin
    totals = [np.concatenate([[0.0], np.cumsum(part)]) for part in _moves(poses)]
    moved, turned = (np.diff(np.interp(grid, times, total)) for total in totals)
    places = np.stack([np.interp(grid, times, poses[:, axis]) for axis in (0, 1)], axis=1)
    headings = poses[0, 2] + np.interp(grid, times, totals[1])
    commands, place, heading = np.zeros((steps, 2)), poses[0, :2], float(poses[0, 2])
    for n in range(steps):
        way, turn = _corrected(places[n] - place, headings[n] - heading, heading, moved[n], turned[n])
        chosen = way / (linear * step), sign * turn / (angular * step)
        commands[n] = fleet.arcs.commands(*chosen, fleet.input_lower, fleet.input_upper)
        # exact arc of the nominal robot: its chord, at the heading in the middle of the step
        v, omega = fleet.arcs.rates(*commands[n])
        half = sign * angular * omega * step / 2
        chord = linear * v * step * np.sinc(half / np.pi)
        place = place + chord * np.array([np.cos(heading + half), np.sin(heading + half)])
        heading += 2 * half
    return commands


def _corrected(off: Floats, askew: float, heading: float, moved: float, turned: float) -> tuple[float, float]:
    """Way and turn of one step: those of the curve, and a part of what the robot is off it (Kanayama et al. 1990)."""
    along = off[0] * np.cos(heading) + off[1] * np.sin(heading)
    beside = off[1] * np.cos(heading) - off[0] * np.sin(heading)
    # aim AHEAD steps ahead on the curve; nothing is done about what is beside a robot that stands
    aim = np.arctan2(np.sign(moved) * beside, AHEAD * abs(moved) + 1e-2) if abs(moved) > 1e-3 else 0.0
    return float(moved + BACK * along), float(turned + BACK * (askew + aim))


def _moves(poses: Floats) -> tuple[Floats, Floats]:
    """Signed lengths and turns from each pose to the next."""
    step = np.diff(poses[:, :2], axis=0)
    turned = (np.diff(poses[:, 2]) + np.pi) % (2 * np.pi) - np.pi
    # the chord's component along the heading in its middle: negative when driven backwards
    middle = poses[:-1, 2] + turned / 2
    ahead = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    return np.where(ahead < 0, -1.0, 1.0) * np.hypot(*step.T), turned


__all__ = ["driven", "needed", "reverses", "tightest", "turning"]
