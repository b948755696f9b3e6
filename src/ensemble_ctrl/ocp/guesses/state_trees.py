"""Guesses that any system can follow: commands found by trees, grown with its own equations, and the states under them.

A way through the map says nothing of how a robot gets along it: whether it can turn there, stop in time, or has to back
out first. A tree in the space of commands does, by OMPL; it grows for the middle member.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.guesses import ompl_paths
from ensemble_ctrl.ocp.guesses.ompl_trees import Growth, State, tree
from ensemble_ctrl.ocp.guesses.registry import Guess, Request, Stop
from ensemble_ctrl.ocp.guesses.state_guesses import Place, itineraries
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.systems.integration import rk4

Floats = NDArray[np.float64]

BATCHES = ((1, 2000), (2, 2000)), ((3, 8000), (4, 8000))
"""Seed and iterations of the trees that are grown side by side, and then if that is no help."""
MOST = 3
"""Ways of doing the task for which trees are grown."""
NEAR = 0.05
"""Share of the map's size within which a place counts as reached, where the region leaves so much room."""
SUBSTEPS = 2
"""Steps of integration in a step of control."""
LARGE = 1e3
"""Size of a state beyond which a member runs away."""


class StateTreeGuesses:
    """Trees for systems that are solved in full states and move in the plane or in space, where OMPL is installed."""

    at_once = False

    def accepts(self, problem: Problem) -> bool:
        """Systems with a position in the plane or in space."""
        states = problem.fleet.system.transcription == "states"
        return states and len(problem.fleet.places) > 1 and ompl_paths.available()

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """Those of each batch."""
        problem = request.problem
        ways = [way for way in itineraries(problem) if way[1]][:MOST]
        for batch in BATCHES if ways else ():
            wanted = [(*way, *each) for way in ways for each in batch]

            def work(stop: Stop, k: int, wanted: list[Wanted] = wanted) -> Guess | None:
                return grown(problem, request.steps, *wanted[k], stop)

            found = request.side_by_side("trees", work, len(wanted))
            if guesses := [guess for guess in found if guess is not None]:
                yield guesses


Wanted = tuple[str, list[Place], int, int]
"""Name and places of a way of doing the task; seed and iterations of a tree."""


def grown(
    problem: Problem,
    steps: int,
    name: str,
    places: Sequence[Place],
    seed: int,
    iterations: int,
    stop: Callable[[], bool],
) -> Guess | None:
    """Commands on a grid of `steps` that bring the middle member to some places, or as near as trees come.

    Parameters
    ----------
    problem : Problem
    steps : int
    name : str
        Of the guess.
    places : sequence of Place
        In their order, each with the latest time to be there; what comes too early waits under the command at rest.
    seed, iterations : int
        As of `ensemble_ctrl.ocp.guesses.ompl_trees.tree`, for each place.
    stop : callable
        Asked in every iteration; returning True ends the search.

    Returns
    -------
    Guess or None
        None where a tree has no free state to begin with.
    """
    member = _Middle(problem, problem.duration / steps)
    commands, state = list[Floats](), member.start
    rest = problem.fleet.rest(problem.fleet.center)
    for k, place in enumerate(places):
        found = tree(
            member.growth(place),
            state,
            place.place,
            member.near(place),
            iterations,
            problem.solve.seed + seed + k,
            stop,
        )
        if not found:
            return None
        legs = [np.tile(command, (count, 1)) for command, count in found]
        waits = place.early + place.dwell - state[-1] - sum(map(len, legs)) * member.step
        legs.append(np.tile(rest, (max(0, round(waits / member.step)), 1)))
        for command in np.concatenate(legs):
            commands.append(command)
            state = member.after(state, command.tolist(), member.step)
    whole = np.array([*commands[:steps], *[rest] * (steps - len(commands))])
    states = problem.fleet.integrated(whole, problem.fleet.center[None], member.step, SUBSTEPS, rk4)
    if not (np.abs(states) < LARGE).all():
        return None
    corners = np.asarray(states[0][:, problem.fleet.place_columns])
    length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    return Guess(whole, corners, length, (), f"{name}, {seed}", "state tree", states.transpose(1, 2, 0))


@dataclass(frozen=True, eq=False)
class _Middle:
    """The middle member; a state is its place, its other states, and the seconds that have passed."""

    problem: Problem
    step: float

    @cached_property
    def order(self) -> list[int]:
        """The system's states, the place first."""
        fleet = self.problem.fleet
        first = [fleet.states.index(name) for name in fleet.places]
        return [*first, *(k for k in range(len(fleet.states)) if k not in first)]

    @cached_property
    def psi(self) -> dict[str, Floats]:
        """Its parameters."""
        return self.problem.fleet.psi(self.problem.fleet.center[None])

    @property
    def start(self) -> list[float]:
        """Its state at the start."""
        states = self.problem.fleet.start_states(self.problem.fleet.center[None])[:, 0]
        return [*states[self.order].tolist(), 0.0]

    def after(self, state: State, command: State, seconds: float) -> list[float]:
        """The state after a command."""
        x = np.empty((len(self.order), 1))
        x[self.order, 0] = state[:-1]
        with np.errstate(all="ignore"):
            x = self.problem.fleet.system.flow(x, command, self.psi, seconds, SUBSTEPS, rk4)
        return [*x[self.order, 0].tolist(), state[-1] + seconds]

    def growth(self, goal: Place) -> Growth:
        """Where the tree grows: in time for the goal, and not into it too early."""
        fleet, rows, near = self.problem.fleet, self._rows, self.near(goal)

        def free(state: State) -> bool:
            at, time = np.array(state[: len(fleet.places)]), state[-1]
            if time > goal.late + 1e-9 or not all(-LARGE < value < LARGE for value in state):
                return False
            too_early = time < goal.early and float(np.linalg.norm(at - goal.place)) <= near
            return not too_early and rows.free(at, time)

        low, high = self._box
        bounds = np.stack([fleet.input_lower, fleet.input_upper], axis=1)
        return Growth(self.after, free, low, high, bounds, self.step)

    def near(self, goal: Place) -> float:
        """How near a place counts as reached."""
        low, high = self._box
        return min(max(goal.room / 2, 1e-3), NEAR * float((high - low).max()))

    @cached_property
    def _box(self) -> tuple[Floats, Floats]:
        """Everything on the map, and a border."""
        problem = self.problem
        shapes = [problem.fleet.start_place[None], *(piece.vertices for _, piece in problem.pieces)]
        shapes += [region.vertices for region in problem.regions.values() if region.is_bounded]
        corners = np.concatenate(shapes)
        border = 0.2 * float(np.ptp(corners, axis=0).max()) + problem.fleet.radius
        return corners.min(axis=0) - border, corners.max(axis=0) + border

    @cached_property
    def _rows(self) -> _Rows:
        """What is in the way."""
        return _Rows(self.problem)


class _Rows:
    """Obstacles as rows ``G x <= h`` of their sides, one block for each piece, grown by what to keep from them."""

    def __init__(self, problem: Problem) -> None:
        avoid = problem.specification.avoid
        pieces: list[tuple[Obstacle, float]] = [
            (piece, constraint.radius + problem.solve.margin) for constraint in avoid for piece in constraint.pieces
        ]
        rows = [piece.unit_rows() for piece, _ in pieces]
        self.first = np.cumsum([0, *(len(h) for _, h in rows[:-1])])
        self.G = np.concatenate([G for G, _ in rows]) if rows else np.zeros((0, 0))
        self.h = (
            np.concatenate([h + keep for (_, h), (_, keep) in zip(rows, pieces, strict=True)]) if rows else self.first
        )
        # windows and motions of the pieces
        owners = [constraint for constraint in avoid for _ in constraint.pieces]
        self.begin = np.array([constraint.begin for constraint in owners])
        self.end = np.array([constraint.end for constraint in owners])
        counts = [len(h) for _, h in rows]
        self.moving = [
            (slice(int(first), int(first) + count), owner)
            for first, count, owner in zip(self.first, counts, owners, strict=False)
            if owner.motion is not None
        ]

    def free(self, place: Floats, time: float) -> bool:
        """Whether a place is outside of all pieces at a time."""
        if not len(self.G):
            return True
        beyond = self.G @ place - self.h
        for rows, owner in self.moving:
            beyond[rows] -= self.G[rows] @ owner.offsets(np.array([time]))[0]
        # in a piece: on the inner side of all of its rows
        inside = np.maximum.reduceat(beyond, self.first) < 0
        return not bool((inside & (time >= self.begin) & (time <= self.end)).any())


__all__ = ["StateTreeGuesses", "grown"]
