"""What members do under given controls: each one's robustness, and the closest approach to every obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import ExactOps, Signals, member_robustness, reads_fleet
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError
from ensemble_ctrl.problem.evaluation.approach import Approach, Closest
from ensemble_ctrl.problem.evaluation.disturbed import disturbed, drawn
from ensemble_ctrl.problem.evaluation.groups import Group, Grouping, PosedGroup, StatesGroup, ordered
from ensemble_ctrl.problem.evaluation.interpolated import ArcCurves
from ensemble_ctrl.problem.evaluation.parametric import ParameterCurves
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.signals import with_signals
from ensemble_ctrl.problem.specification import TaskPart, unjudged_bodies

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GROUP = 164_000
"""Members times sampled times in one group: its arrays stay in the processor's cache."""
MANY = 1000
"""Members from which on polynomials are made of the states of systems that an ODE defines."""
PROBES = 17
"""Members that are looked at first, for distances that the others need not be compared with."""


@dataclass(frozen=True, eq=False)
class Judged:
    """What some members do.

    Attributes
    ----------
    robustness : ndarray, shape (members,)
        Of everything that each member has to do: `parts` that are no chance constraints, and distances, metres.
    parts : ndarray, shape (parts, members)
        Robustness of each part of the task in the order of `Specification.parts`; of a chance constraint, of what a
        share of the members does.
    closest : tuple of Closest
        One for each avoided obstacle; their members are rows of what was judged.
    """

    robustness: Floats
    parts: Floats
    closest: tuple[Closest, ...]


class Judge:
    """Everything that is the same for all members of a problem under given controls.

    Parameters
    ----------
    problem : Problem
        Fleet, map and task.
    controls : ndarray, shape (steps, n_u)
        The broadcast commands.
    substeps : int
        Samples per step, of the distances and of every part of the task.
    members : ndarray, shape (members, parameters), optional
        Whom it will be asked about, if they need not be in the fleet's ranges.
    dice : int, optional
        Seed of what disturbs each member within the fleet's bounds; members follow their model if not given.
    """

    def __init__(
        self,
        problem: Problem,
        controls: Floats,
        substeps: int,
        members: Floats | None = None,
        dice: int | None = None,
    ) -> None:
        self.problem, self.controls, self.substeps, self.dice = problem, np.asarray(controls, float), substeps, dice
        self.fine = np.repeat(self.controls, substeps, axis=0)
        if why := unjudged_bodies(problem):
            raise UnsupportedError(why)
        self.times = np.linspace(0.0, problem.duration, len(self.fine) + 1)
        specification = problem.specification
        self.approach = Approach(specification.avoid, self.times)
        self.chances = {id(chance.part): chance for chance in specification.chance}
        self.approaches = {key: Approach(chance.avoid, self.times) for key, chance in self.chances.items()}
        self.everyone = [k for k, part in enumerate(specification.parts) if id(part) not in self.chances]
        self.together = any(reads_fleet(part.written) for part in specification.rest)
        self.covered = problem.fleet.corners if members is None else members

    @cached_property
    def curves(self) -> ArcCurves | ParameterCurves | None:
        """Polynomials that give every member's states, where there are some."""
        if self.together or self.dice is not None:
            return None
        fleet, step = self.problem.fleet, self.problem.duration / len(self.fine)
        if fleet.system.on_arcs:
            return ArcCurves.of(fleet, self.fine, step, self.covered, self.problem.specification.signals)
        return ParameterCurves.of(fleet, self.fine, step, self.covered)

    @property
    def size(self) -> int:
        """Members in one group."""
        return max(1, GROUP // len(self.times))

    def judge(self, members: Floats) -> Judged:
        """What members of shape (members, parameters) do.

        Notes
        -----
        *Guarantee*: as if every position of every member had been computed, to the error of the positions
        (`ArcCurves.error` for robots on arcs; for others `ensemble_ctrl.problem.integrated.ACCURACY`, and
        `ensemble_ctrl.problem.evaluation.parametric.ERROR`).
        """
        closest = tuple(Closest() for _ in self.approach.avoid)
        robustness = np.empty(len(members))
        parts = np.empty((len(self.problem.specification.parts), len(members)))
        grouping = self._grouping(members)
        groups = [np.arange(len(members))] if self.together else list(ordered(members, self.size))
        if len(groups) > 1 and closest and self.dice is None:
            self._probe(members, groups, grouping, closest)
        for here in groups:
            group = grouping(members[here])
            parts[:, here] = least = self._parts(group, here)
            own = least[self.everyone].min(axis=0, initial=np.inf)
            self.approach.judge(group, here, own, closest)
            robustness[here] = own
        return Judged(robustness, parts, closest)

    def _grouping(self, members: Floats) -> Grouping:
        """Polynomials where there are some for all of these members and they pay, else all states."""
        pays = self.problem.fleet.system.on_arcs or len(members) >= MANY
        curves = self.curves if pays else None
        grouping = self._states if curves is None or not curves.covers(members) else curves.group
        return grouping if self.problem.fleet.footprint is None else partial(self._posed, grouping)

    def _posed(self, grouping: Grouping, members: Floats) -> Group:
        """A group with headings."""
        fleet, step = self.problem.fleet, self.problem.duration / len(self.fine)
        _, omega = fleet.arcs.rates(*self.fine.T)
        turned = np.concatenate([[0.0], step * np.cumsum(omega)])
        return PosedGroup(grouping(members), fleet.coefficients(members), turned, fleet.arcs.heading_from)

    def _probe(self, members: Floats, groups: Sequence[Ints], grouping: Grouping, closest: Sequence[Closest]) -> None:
        """The distances of a few members, both ends of their order among them; who is inside is counted later."""
        order = np.concatenate(groups)
        some = order[np.linspace(0, len(order) - 1, PROBES).round().astype(int)]
        self.approach.judge(grouping(members[some]), some, np.full(len(some), -np.inf), closest)
        for one in closest:
            one.inside = 0

    def _states(self, members: Floats) -> Group:
        """A group of which every state is computed."""
        problem = self.problem
        if self.dice is not None:
            # settings of a group follow from its members, whatever the order of the groups
            seed = [self.dice, crc32(members.tobytes())]
            settings = drawn(problem, len(members), len(self.controls), seed)
            return StatesGroup(problem, disturbed(problem, self.controls, members, settings, self.substeps))
        step = problem.duration / len(self.fine)
        states = problem.fleet.trajectories(self.fine, members, step)
        return StatesGroup(problem, with_signals(problem, states, self.fine, members, step))

    def _parts(self, group: Group, members: Ints) -> Floats:
        """Robustness of the parts of the task, shape (parts, members)."""
        found = np.empty((len(self.problem.specification.parts), len(members)))
        signals = group.signals
        for row, part in zip(found, self.problem.specification.parts, strict=True):
            chance = self.chances.get(id(part))
            # of a chance constraint, each member's least over all that the share does
            row[:] = _least([part] if chance is None else chance.rest, signals)
            if chance is not None:
                self.approaches[id(part)].judge(group, members, row, None)
        return found


def _least(parts: Sequence[TaskPart], signals: Signals) -> Floats:
    """The least robustness over some parts, at time 0, for every member."""
    least = np.full(signals.members, np.inf)
    for part in parts:
        np.minimum(least, member_robustness(part.formula, signals, ExactOps())[:, 0], out=least)
    return least
