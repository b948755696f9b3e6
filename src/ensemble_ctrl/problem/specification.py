"""The compiled task: what must be avoided when, what a share of the fleet has to do, and the rest.

`Problem.specification` makes it once; planner, certificate, replay and report read it. Conjuncts of the form
``G[a,b] avoid(...)`` become `AvoidConstraint`: the program gives them separating hyperplanes for whole step intervals,
replay and certificate check them at every instant. Every other conjunct is a `TaskPart` and has a robustness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.disc import obstacle_of
from ensemble_ctrl.constraints.obstacle import Obstacle
from ensemble_ctrl.constraints.stl.formula import Always, Formula, Not, Share
from ensemble_ctrl.constraints.stl.implied import outermost, without_implied
from ensemble_ctrl.constraints.stl.leaves import Apart, Avoid, Inside
from ensemble_ctrl.constraints.stl.rewrite import (
    ALL_OBSTACLES,
    conjuncts,
    ground,
    kept_out,
    leaves,
    reads_fleet,
    resolve,
)
from ensemble_ctrl.problem.signals import angle_range, signals_read
from ensemble_ctrl.problem.starts import keeps_apart
from ensemble_ctrl.problem.zones import required, rules, zone_pieces

if TYPE_CHECKING:
    from ensemble_ctrl.constraints.footprint import Footprint
    from ensemble_ctrl.constraints.motion import Motion
    from ensemble_ctrl.problem.problem import Problem

Floats = NDArray[np.float64]

NOTHING_AVOIDED = "no obstacle is to be avoided"
"""What an infinite clearance means."""
NOTHING_REQUIRED = "nothing is required: the task avoids no obstacle that is there, and has no other part"
"""What an infinite robustness means."""


@dataclass(frozen=True, eq=False)
class AvoidConstraint:
    """Clearance of at least zero from one named obstacle or region during a window.

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
    footprint : Footprint or None
        The body that is kept out of it; the planned point alone without one, and for ``not in``.
    """

    name: str
    pieces: tuple[Obstacle, ...]
    radius: float
    begin: float
    end: float
    motion: Motion | None = None
    footprint: Footprint | None = None

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

    def distances(self, paths: Floats, times: Floats, headings: Floats | None = None) -> Floats:
        """Distance from it during its window, (members, times in it), metres; `headings` are those of bodies."""
        when = self.during(times)
        # min over the pieces of the distance in the obstacle's frame, p(t) - offset(t), less the radius
        seen = paths[:, when] - self.offsets(times[when])
        if self.footprint is None:
            each = [piece.distance(seen) for piece in self.pieces]
        else:
            assert headings is not None, "the distance of a body needs its headings"
            each = [self.footprint.distance(piece, seen, headings[:, when]) for piece in self.pieces]
        return np.asarray(np.minimum.reduce(each) - self.radius)

    def steps(self, steps: int, duration: float, begin: float = 0.0) -> NDArray[np.bool_]:
        """Which of `steps` equal steps from time `begin` on a plan has to avoid it in, shape (steps,).

        Those that share more than an instant with the window; for a window that is about an instant, those that touch
        it. For the planner: a proof uses the window itself (`ensemble_ctrl.certificate.instants`).
        """
        edges = np.linspace(begin, begin + duration, steps + 1)
        # steps that overlap the window by more than rounding; a window of one instant counts for the steps it touches
        slack = 1e-9 * duration
        slack = -slack if self.end - self.begin <= 2 * slack else slack
        return np.asarray((edges[:-1] < self.end - slack) & (edges[1:] > self.begin + slack))


@dataclass(frozen=True, eq=False)
class AvoidThroughout:
    """A conjunct ``G[a,b] (avoid(...) and not in(...) and ...)``.

    Attributes
    ----------
    written : Always
        As the task has it.
    begin, end : float
        Its window in seconds; the whole horizon where it has none.
    """

    written: Always
    begin: float
    end: float

    @classmethod
    def of(cls, problem: Problem, written: Always) -> AvoidThroughout:
        """The conjunct with its window resolved."""
        return cls(written, *_window(problem, resolve(written, problem.duration)))

    def constraints(self, problem: Problem) -> Iterator[AvoidConstraint]:
        """One constraint for each obstacle and region; several in turn for what is ever less certain where it is."""
        fleet = problem.fleet
        for leaf in kept_out(self.written):
            if isinstance(leaf, Avoid):
                for name in avoided(problem, leaf):
                    pieces, motion, body = named_pieces(problem, name), problem.motions.get(name), fleet.footprint
                    slices = [(self.begin, self.end, 0.0)] if motion is None else motion.slices(self.begin, self.end)
                    for begin, end, more in slices:
                        yield AvoidConstraint(name, pieces, fleet.radius + more, begin, end, motion, body)
            elif isinstance(leaf, Not) and isinstance(leaf.child, Inside):
                name = leaf.child.name
                yield AvoidConstraint(name, named_pieces(problem, name), 0.0, self.begin, self.end)


@dataclass(frozen=True)
class ApartConstraint:
    """A conjunct ``G[a,b] apart(d)``: members of different starts keep away from each other.

    Attributes
    ----------
    distance : float
        Metres between their centres.
    begin, end : float
        Its window in seconds; the whole horizon where it has none.
    """

    distance: float
    begin: float
    end: float

    def __str__(self) -> str:
        return str(Apart(self.distance))


@dataclass(frozen=True, eq=False)
class TaskPart:
    """A conjunct of the task with a robustness.

    Attributes
    ----------
    written : Formula
        As the task has it; its text names the part.
    resolved : Formula
        The same with seconds where a window has ``T``.
    begin, end : float
        Window of its outermost operator in seconds; the whole horizon where it has none.
    grounding : callable
        Gives `formula`.
    limit : bool
        Whether it is the rule of a zone: a plan keeps it, and gains nothing by more than that.
    """

    written: Formula
    resolved: Formula
    begin: float
    end: float
    grounding: Callable[[], Formula]
    limit: bool = False

    @classmethod
    def of(cls, problem: Problem, written: Formula) -> TaskPart:
        """A formula over the map and the states of a problem."""
        fleet = problem.fleet
        resolved = resolve(written, problem.duration)
        grounding = partial(
            ground,
            resolved,
            problem.regions,
            problem.obstacles,
            position=fleet.places,
            radius=fleet.radius,
            angles=partial(angle_range, problem),
            zones=zone_pieces(problem.zones),
        )
        limit = written in rules(problem).values()
        return cls(written, resolved, *_window(problem, resolved), grounding, limit)

    @cached_property
    def formula(self) -> Formula:
        """The part with linear predicates as its only leaves, and with seconds in its windows."""
        return self.grounding()

    def __str__(self) -> str:
        return str(self.written)


@dataclass(frozen=True, eq=False)
class ChanceConstraint:
    """A part of the task that a share of the fleet has to do, and the same members all of it.

    Attributes
    ----------
    part : TaskPart
        The conjunct ``share(p, f)``.
    share : Share
        As it was written.
    avoid : tuple of AvoidConstraint
        What these members avoid.
    rest : tuple of TaskPart
        What else they do.
    """

    part: TaskPart
    share: Share
    avoid: tuple[AvoidConstraint, ...]
    rest: tuple[TaskPart, ...]


@dataclass(frozen=True, eq=False)
class Specification:
    """The task of one problem, in parts that all have to hold; windows are exact, in seconds.

    Attributes
    ----------
    task : Formula
        The whole task, with the rules of all zones and with seconds where a window has ``T``.
    always : tuple of AvoidThroughout
        The conjuncts that `avoid` comes from.
    avoid : tuple of AvoidConstraint
        One for each obstacle or region and window that no other one contains.
    parts : tuple of TaskPart
        Every other conjunct that no other one implies, in the order of the task.
    chance : tuple of ChanceConstraint
        Those of `parts` that are ``share(p, f)`` with p below 1, where `f` is read for each member.
    signals : tuple of str
        What the task refers to besides the states of trajectories, such as the heading of robots on arcs.
    apart : tuple of ApartConstraint
        How far members of different starts keep from each other.
    """

    task: Formula
    always: tuple[AvoidThroughout, ...]
    avoid: tuple[AvoidConstraint, ...]
    parts: tuple[TaskPart, ...]
    chance: tuple[ChanceConstraint, ...]
    sources: tuple[object, ...]
    signals: tuple[str, ...] = ()
    apart: tuple[ApartConstraint, ...] = ()

    @classmethod
    def of(cls, problem: Problem) -> Specification:
        """Compile the task of a problem."""
        task = required(problem)
        always, parts = _split(problem, task)
        return cls(
            resolve(task, problem.duration),
            always,
            _avoid(problem, always),
            parts,
            tuple(_chance(problem, part) for part in parts if _is_chance(part.written)),
            _sources(problem),
            signals_read(problem),
            tuple(_apart(problem, part) for part in conjuncts(problem.task) if keeps_apart(part)),
        )

    @property
    def rest(self) -> tuple[TaskPart, ...]:
        """The parts that are no chance constraints."""
        return tuple(part for part in self.parts if not _is_chance(part.written))

    @property
    def avoided_by_anyone(self) -> tuple[AvoidConstraint, ...]:
        """What every member, or a share of them, avoids."""
        return (*self.avoid, *(avoid for chance in self.chance for avoid in chance.avoid))

    @property
    def elsewhere(self) -> str:
        """Why bodies can't be judged: apart, or avoid otherwise than throughout a window; empty where they can."""
        found = [part for part in self.parts if any(isinstance(leaf, Avoid) for leaf in leaves(part.written))]
        if found:
            return f"with a footprint, expected avoid(...) in a part G avoid(...) of its own, got {found[0]}"
        return "apart(...) is about planned points: it is not for members with a footprint" if self.apart else ""

    def is_of(self, problem: Problem) -> bool:
        """Whether the problem still has the map, fleet, task and horizon that this was compiled from."""
        return all(here is there for here, there in zip(self.sources, _sources(problem), strict=True))


def _sources(problem: Problem) -> tuple[object, ...]:
    """Everything of a problem that its specification depends on."""
    shapes = problem.regions, problem.obstacles, problem.motions, problem.zones
    return problem.task, problem.duration, *shapes, problem.fleet


def _split(problem: Problem, task: Formula) -> tuple[tuple[AvoidThroughout, ...], tuple[TaskPart, ...]]:
    """The conjuncts that only avoid, and the others; without those that others imply."""
    needed = [part for part in without_implied(conjuncts(task), problem.duration) if not keeps_apart(part)]
    # G (avoid and ...) becomes constraints on the clearance, every other conjunct keeps its robustness
    always = (part for part in needed if isinstance(part, Always) and kept_out(part))
    others = (part for part in needed if not kept_out(part))
    return tuple(AvoidThroughout.of(problem, part) for part in always), tuple(TaskPart.of(problem, p) for p in others)


def _apart(problem: Problem, part: Formula) -> ApartConstraint:
    """The constraint of one ``G[a,b] apart(d)``."""
    (leaf,) = part.parts
    assert isinstance(leaf, Apart)
    return ApartConstraint(leaf.distance, *_window(problem, resolve(part, problem.duration)))


def _is_chance(part: Formula) -> bool:
    """Whether the same members have to do all of a part, and not all members."""
    return isinstance(part, Share) and not part.strict and not reads_fleet(part.child)


def _chance(problem: Problem, part: TaskPart) -> ChanceConstraint:
    """The constraint of one ``share(p, f)``."""
    assert isinstance(part.written, Share)
    always, rest = _split(problem, part.written.child)
    return ChanceConstraint(part, part.written, _avoid(problem, always), rest)


def _window(problem: Problem, resolved: Formula) -> tuple[float, float]:
    """The window of a formula's outermost operator in seconds; the whole horizon where it has none."""
    begin, end = getattr(resolved, "a", None), getattr(resolved, "b", None)
    return float(begin or 0.0), problem.duration if end is None else float(end)


def unjudged_bodies(problem: Problem) -> str:
    """Why the bodies of a problem's robots can't be judged; empty where they can, and where there are none."""
    fleet = problem.fleet
    if fleet.footprint is None:
        return ""
    if fleet.uncertainty or problem.terrain or not fleet.system.on_arcs:
        return "headings are not bounded, and so neither are the corners of a footprint"
    return problem.specification.elsewhere


def _avoid(problem: Problem, parts: Iterable[AvoidThroughout]) -> tuple[AvoidConstraint, ...]:
    """The constraints of some conjuncts; of windows within each other the longest."""
    found = [avoid for part in parts for avoid in part.constraints(problem)]
    groups: dict[tuple[str, float, bool], list[int]] = {}
    for k, avoid in enumerate(found):
        groups.setdefault((avoid.name, avoid.radius, avoid.footprint is None), []).append(k)
    kept = {same[k] for same in groups.values() for k in outermost([(found[k].begin, found[k].end) for k in same])}
    return tuple(avoid for k, avoid in enumerate(found) if k in kept)


def avoided(problem: Problem, leaf: Avoid) -> tuple[str, ...]:
    """The obstacles or regions that a leaf avoids, by their names."""
    everything = leaf.name == ALL_OBSTACLES and leaf.name not in problem.obstacles
    return tuple(problem.obstacles) if everything else (leaf.name,)


def named_pieces(problem: Problem, name: str) -> tuple[Obstacle, ...]:
    """The convex pieces of an obstacle or a zone, or the one of a region."""
    if name in problem.obstacles:
        return problem.obstacles[name]
    if name in problem.zones:
        return problem.zones[name].pieces
    return (obstacle_of(problem.regions[name]),)


def clearances(problem: Problem, paths: Floats, most: float, headings: Floats | None = None) -> Floats:
    """Smallest distance of each path from what all avoid, at most `most`, (members,), metres; `headings` of bodies."""
    least = np.full(len(paths), most)
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    for avoid in problem.specification.avoid:
        least = np.minimum(least, avoid.distances(paths, times, headings).min(axis=1, initial=np.inf))
    return least
