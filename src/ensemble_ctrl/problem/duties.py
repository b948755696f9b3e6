"""A task in two parts: what must be kept out of all the time, and the rest.

Conjuncts of the form ``G[a,b] avoid(...)`` are safety: the planner turns them into separating hyperplanes for whole
step intervals, replay and certificate check them at every instant.  Everything else has a robustness.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.obstacle import Obstacle
from ensemble_ctrl.constraints.solid import Solid
from ensemble_ctrl.constraints.stl.formula import Formula, Not, Share
from ensemble_ctrl.constraints.stl.implied import outermost, without_implied
from ensemble_ctrl.constraints.stl.leaves import Avoid, Inside
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES, conjuncts, ground, kept_out, reads_fleet, resolve

if TYPE_CHECKING:
    from ensemble_ctrl.constraints.motion import Motion
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

NOTHING_AVOIDED = "no obstacle is to be avoided"
"""What an infinite clearance means."""
NOTHING_ASKED = "nothing is asked: the task avoids no obstacle that is there, and has no other part"
"""What an infinite robustness means."""


@dataclass(frozen=True, eq=False)
class Duty:
    """Keep out of one named obstacle or region during a window.

    Attributes
    ----------
    name : str
        Of the obstacle or region.
    pieces : tuple of Obstacle
        Its convex pieces.
    radius : float
        Metres by which it grows: the robot's radius for ``avoid``, none for ``not in``.
    begin, end : float
        Seconds.
    motion : Motion or None
        How it moves from where its pieces are.
    """

    name: str
    pieces: tuple[Obstacle, ...]
    radius: float
    begin: float
    end: float
    motion: Motion | None = None

    def offsets(self, times: Floats) -> Floats:
        """Its displacement at some times, shape (times, d), metres."""
        return np.zeros((len(times), self.pieces[0].A.shape[1])) if self.motion is None else self.motion.at(times)

    def bends(self, times: Floats) -> Floats:
        """How far it leaves a straight line between successive times, shape (times - 1,), metres."""
        return np.zeros(len(times) - 1) if self.motion is None else self.motion.bend(times[:-1], times[1:])

    def during(self, times: Floats) -> NDArray[np.bool_]:
        """Which times are in its window, or miss it by rounding.

        Those of 1e-9 s outside count: looking at more can only take from a clearance.
        """
        return np.asarray((times >= self.begin - 1e-9) & (times <= self.end + 1e-9))

    def distances(self, paths: Floats, times: Floats) -> Floats:
        """Distance of members from it during its window, shape (members, times in the window), metres."""
        when = self.during(times)
        seen = paths[:, when] - self.offsets(times[when])
        return np.asarray(np.minimum.reduce([piece.distance(seen) for piece in self.pieces]) - self.radius)

    def steps(self, steps: int, duration: float, begin: float = 0.0) -> NDArray[np.bool_]:
        """Which of `steps` equal steps from time `begin` on a plan keeps out in, shape (steps,).

        Those that share more than an instant with the window; for a window that is about an instant, those that touch
        it. For the planner: a proof looks at the window itself (`ensemble_ctrl.certificate.instants`).
        """
        edges = np.linspace(begin, begin + duration, steps + 1)
        slack = 1e-9 * duration
        slack = -slack if self.end - self.begin <= 2 * slack else slack
        return np.asarray((edges[:-1] < self.end - slack) & (edges[1:] > self.begin + slack))


@dataclass(frozen=True, eq=False)
class Chance:
    """A part of the task that a share of the fleet has to do, and the same members all of it.

    Attributes
    ----------
    part : Share
        As it was written.
    duties : tuple of Duty
        What these members keep out of.
    others : tuple of Formula
        What else they do.
    """

    part: Share
    duties: tuple[Duty, ...]
    others: tuple[Formula, ...]


def chances(problem: Problem) -> tuple[Chance, ...]:
    """Every conjunct ``share(p, f)`` of the task with p below 1, where `f` is read for each member."""
    return tuple(
        Chance(
            part,
            _duties(problem, without_implied(conjuncts(part.child), problem.duration)),
            tuple(p for p in without_implied(conjuncts(part.child), problem.duration) if not kept_out(p)),
        )
        for part in problem.conjuncts
        if isinstance(part, Share) and not part.strict and part.p < 1 and not reads_fleet(part.child)
    )


def duties(problem: Problem) -> tuple[Duty, ...]:
    """Every duty of the task, one for each obstacle or region and window that no other one contains."""
    return _duties(problem, problem.conjuncts)


def other_parts(problem: Problem) -> tuple[Formula, ...]:
    """The conjuncts that are not duties, as they were written."""
    return tuple(part for part in problem.conjuncts if not kept_out(part))


def grounded(problem: Problem, part: Formula) -> Formula:
    """A part of the task with linear predicates as its only leaves and ``T`` resolved."""
    resolved, fleet = resolve(part, problem.duration), problem.fleet
    return ground(resolved, problem.regions, problem.obstacles, position=fleet.places, radius=fleet.radius)


def window_of(problem: Problem, part: Formula) -> tuple[float, float]:
    """The window of a part's outermost operator in seconds; the whole horizon where it has none."""
    resolved = resolve(part, problem.duration)
    begin, end = getattr(resolved, "a", None), getattr(resolved, "b", None)
    return float(begin or 0.0), problem.duration if end is None else float(end)


def _duties(problem: Problem, parts: Sequence[Formula]) -> tuple[Duty, ...]:
    """The duties of some conjuncts."""
    found = [duty for part in parts for duty in _duties_of(problem, part)]
    groups: dict[tuple[str, float], list[int]] = {}
    for k, duty in enumerate(found):
        groups.setdefault((duty.name, duty.radius), []).append(k)
    kept = {same[k] for same in groups.values() for k in outermost([(found[k].begin, found[k].end) for k in same])}
    return tuple(duty for k, duty in enumerate(found) if k in kept)


def _duties_of(problem: Problem, part: Formula) -> Iterator[Duty]:
    """The duties of one conjunct."""
    for leaf in kept_out(part):
        window = window_of(problem, part)
        if isinstance(leaf, Avoid):
            for name in avoided(problem, leaf):
                yield Duty(name, named_pieces(problem, name), problem.fleet.radius, *window, problem.motions.get(name))
        elif isinstance(leaf, Not) and isinstance(leaf.child, Inside):
            yield Duty(leaf.child.name, named_pieces(problem, leaf.child.name), 0.0, *window)


def avoided(problem: Problem, leaf: Avoid) -> tuple[str, ...]:
    """The obstacles or regions that a leaf keeps out of, by their names."""
    everything = leaf.name == ALL_OBSTACLES and leaf.name not in problem.obstacles
    return tuple(problem.obstacles) if everything else (leaf.name,)


def named_pieces(problem: Problem, name: str) -> tuple[Obstacle, ...]:
    """The convex pieces of an obstacle, or the one of a region."""
    if name in problem.obstacles:
        return problem.obstacles[name]
    region = problem.regions[name]
    return ((Solid.hull if region.A.shape[1] == 3 else Obstacle.polygon)(region.vertices),)


def clearances(problem: Problem, paths: Floats, most: float) -> Floats:
    """Smallest distance of each path from what everybody keeps out of, at most `most`, shape (members,), metres."""
    least = np.full(len(paths), most)
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    for duty in duties(problem):
        least = np.minimum(least, duty.distances(paths, times).min(axis=1, initial=np.inf))
    return least
