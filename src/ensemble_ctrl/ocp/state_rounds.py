"""Rounds of solving for any system, by multiple shooting: the middle member first, then the fleet."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.ocp.disturbance import growth
from ensemble_ctrl.ocp.evaluate_sampled import INFINITE, with_middle
from ensemble_ctrl.ocp.guesses.registry import Guess
from ensemble_ctrl.ocp.guesses.restarts import Restart
from ensemble_ctrl.ocp.hyperplanes import separate
from ensemble_ctrl.ocp.rounds import GAIN, Attempt, rank, with_work
from ensemble_ctrl.ocp.solvers import Outcome, SolverOptions, Watch, solve
from ensemble_ctrl.ocp.transcription import Avoiding, Iterate, transcribe
from ensemble_ctrl.ocp.truncation import Truncation, nominal
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.integrated import needed
from ensemble_ctrl.systems.integration import rk4

Floats = NDArray[np.float64]

ACCURACY = 1e-5
"""Error of the integration within the program; what judges the controls integrates more accurately."""
MOST_SUBSTEPS = 8
"""Runge-Kutta steps in a step of control within the program."""
NOMINAL_ROUNDS, FLEET_ROUNDS = 3, 5
ORDERS = {0: 0, 1: 3, 2: 2}
"""Truncation order for so many parameters unless the problem says another, else 1."""
NEARLY = 0.05
"""Of a unit by which the middle member may fall short, since the fleet's program starts from it anyway."""
SMALL = 1e-4
"""Metres kept to spare beyond what was missing."""
RESTART_SUBSTEPS = 4
"""Runge-Kutta steps in a step of control where what controls a system needs is not known yet."""
RUNAWAY_FACTOR = 50.0
"""Times the size of the guess beyond which a simulated state is no use as a start."""


class Clock(Protocol):
    """What the search asks of whoever runs it."""

    def options(self, barrier: float, tolerance: float) -> SolverOptions:
        """Solver options within what is left of the time."""

    def over(self) -> bool:
        """Whether to stop now with what there is."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One choice of node robots, and how finely they are integrated."""

    problem: Problem
    truncation: Truncation
    substeps: int

    def simulated(self, controls: Floats) -> Iterate:
        """The node robots under `controls`."""
        fleet = self.problem.fleet
        members = fleet.dynamic_members(self.truncation.nodes)
        states = fleet.integrated(controls, members, self.problem.duration / len(controls), self.substeps, rk4)
        return Iterate(controls, states.transpose(1, 2, 0), self.substeps)

    def avoiding(self, iterate: Iterate) -> Avoiding:
        """Separating hyperplanes at an iterate, a row for every pair."""
        # points P = C p(nodes), from the places among the nodes' states
        positions = iterate.states[:, self.problem.fleet.place_columns].transpose(0, 2, 1)
        points = np.einsum("ij,tjd->tid", self.truncation.to_points, positions)
        hyperplanes = separate(
            points, self.problem.specification.avoid, self.problem.duration, parts=self.truncation.parts
        )
        in_moments = self.problem.solve.guarantee == "moment"
        errors = growth(self.problem, iterate.controls)
        hyperplanes = hyperplanes if errors is None else hyperplanes.grown(errors.within)
        return Avoiding(hyperplanes, hyperplanes.active & (not in_moments))

    def alike(self, controls: Floats, states: Floats) -> Iterate:
        """Every node robot with the same states, of shape (steps + 1, n_x, 1), whatever it would do by itself."""
        return Iterate(controls, np.repeat(states, len(self.truncation.nodes), axis=2), self.substeps)


def whole(problem: Problem, order: int | None = None) -> Truncation:
    """Node robots for the whole fleet, at the order given or the problem's, and what of them keeps the constraints."""
    count = len(problem.fleet.names)
    if order is None:
        order = ORDERS.get(count, 1) if problem.order is None else problem.order
    fleet, degrees = problem.fleet, (order,) * count
    joint = None if fleet.samples is None else fleet.rule(order + 1)
    hull = problem.solve.guarantee == "hull"
    return Truncation(degrees, degrees, hull, fleet.dynamic_distributions, problem.solve.cells, joint)


def first(problem: Problem, guess: Guess, clock: Clock, watch: Watch | None) -> tuple[Attempt, Floats]:
    """Controls for the middle member from a geometric guess, with its states, shape (steps + 1, n_x, 1)."""
    stage = Stage(problem, nominal(problem), _substeps(problem, guess.iterate.controls))
    iterate = replace(guess.iterate, substeps=stage.substeps)
    found, states = _rounds(stage, iterate, NOMINAL_ROUNDS, clock, watch, 1e-1)
    if stage.substeps >= MOST_SUBSTEPS or clock.over() or middle_does(found):
        return found, states
    stage = replace(stage, substeps=MOST_SUBSTEPS)
    iterate = replace(guess.iterate, substeps=stage.substeps)
    more, states = _rounds(stage, iterate, NOMINAL_ROUNDS, clock, watch, 1e-1)
    return with_work(more, found, more), states


def second(problem: Problem, controls: Floats, states: Floats, clock: Clock, watch: Watch | None) -> Attempt:
    """Controls for the whole fleet from those of the middle member and its states."""
    stage = Stage(problem, whole(problem), _substeps(problem, controls))
    iterate = stage.simulated(controls)
    # unstable systems: node robots that run away under the middle member's commands start from its states
    size = RUNAWAY_FACTOR * max(1.0, float(np.abs(states).max()))
    if not (np.abs(iterate.states) <= size).all():
        iterate = stage.alike(controls, states)
    return _rounds(stage, iterate, FLEET_ROUNDS, clock, watch, 1e-2)[0]


def improved(problem: Problem, controls: Floats, clock: Clock) -> Attempt:
    """Controls for the whole fleet from some that are nearly good, as good as there is time for."""
    stage = Stage(problem, whole(problem), _substeps(problem, controls))
    return _rounds(stage, stage.simulated(controls), FLEET_ROUNDS, clock, None, 1e-3)[0]


def again(problem: Problem, restart: Restart, clock: Clock, watch: Watch | None) -> Attempt:
    """Controls for the whole fleet from another start: all node robots have the states of one member at first."""
    stage = Stage(problem, whole(problem, restart.order), RESTART_SUBSTEPS)
    iterate = stage.alike(restart.controls, restart.states)
    return _rounds(stage, iterate, FLEET_ROUNDS, clock, watch, restart.barrier)[0]


def middle_does(attempt: Attempt) -> bool:
    """Whether the middle member, alone, does the task under an attempt's controls, or nearly."""
    value = attempt.middle or attempt.value
    return value.keeps(-NEARLY) and value.excess <= NEARLY


def given(problem: Problem, controls: Floats) -> tuple[Attempt, Floats]:
    """A caller's controls as an attempt that cost nothing, with the middle member's states."""
    stage = Stage(problem, nominal(problem), _substeps(problem, controls))
    return _start(stage, controls), np.nan_to_num(stage.simulated(controls).states)


def runs_away(attempt: Attempt) -> bool:
    """Whether some state is not finite."""
    return attempt.value.gap <= -INFINITE


def _substeps(problem: Problem, controls: Floats) -> int:
    """Runge-Kutta steps within the program."""
    try:
        # Runge-Kutta steps for ACCURACY; half of them is enough within the program
        found = needed(problem.fleet, controls, problem.duration / len(controls), ACCURACY, rk4)
    except ProblemError:
        return MOST_SUBSTEPS
    return min(MOST_SUBSTEPS, max(1, found // 2))


def _start(stage: Stage, controls: Floats) -> Attempt:
    """The guess as an attempt that cost nothing."""
    value, middle = with_middle(stage.problem, controls)
    return Attempt(controls, value, stage.truncation, "failed", "not solved", 0, 0.0, 0.0, 0, middle)


def _rounds(
    stage: Stage, iterate: Iterate, rounds: int, clock: Clock, watch: Watch | None, barrier: float
) -> tuple[Attempt, Floats]:
    """Solve, choose the hyperplanes anew at the solution, keep to spare what was missing, and solve again."""
    best, found, spare = _start(stage, iterate.controls), iterate, (0.0, 0.0)
    before, standing = best, _stands(stage, best)
    for k in range(rounds):
        solved, iterate = _round(stage, iterate, spare, clock.options(barrier if k == 0 else 1e-3, 1e-4), watch)
        place = _stands(stage, solved)
        better = place < standing or (best.iterations == 0 and solved.value.keeps(0.0))
        standing = place if better else standing
        gain = best.value.cost - solved.value.cost
        # ends: feasible and the cost falls by less than GAIN, or more to spare has changed nothing
        settled = solved.value.keeps(0.0) and best.value.keeps(0.0) and gain < GAIN
        stuck = k > 0 and not solved.value.keeps(0.0) and _as_short(solved, before)
        before = solved
        kept = solved if better else best
        found = iterate if better else found
        best = with_work(kept, best, solved)
        if settled or stuck or solved.status in ("interrupted", "limit") or clock.over():
            break
        spare = _more(spare, solved, len(stage.truncation.nodes))
    return best, found.states


def _as_short(solved: Attempt, before: Attempt) -> bool:
    """Whether more to spare changed nothing: the solver is where the task falls short least around there."""
    pairs = ((solved.value.robustness, before.value.robustness), (solved.value.gap, before.value.gap))
    return all(bool(np.isclose(new, old, rtol=1e-3, atol=SMALL)) for new, old in pairs)


def _more(spare: tuple[float, float], solved: Attempt, nodes: int) -> tuple[float, float]:
    """What to keep to spare next: more by what a finer replay of the fleet finds missing."""
    # more to spare by one and a half times what is missing, where that is less than a metre
    missing = (max(0.0, -solved.value.gap), max(0.0, -solved.value.robustness))
    if nodes == 1 or max(missing) >= 1.0:
        return spare
    grown = [s + (1.5 * m + SMALL if m > 0 else 0.0) for s, m in zip(spare, missing, strict=True)]
    return grown[0], grown[1]


def _round(
    stage: Stage, iterate: Iterate, spare: tuple[float, float], options: SolverOptions, watch: Watch | None
) -> tuple[Attempt, Iterate]:
    """One choice of hyperplanes."""
    problem, began = stage.problem, time.perf_counter()
    avoiding = stage.avoiding(iterate)
    program = transcribe(problem, stage.truncation, iterate, avoiding, spare)
    built = time.perf_counter()
    outcome = solve(program.nlp, options, watch)
    solved = time.perf_counter()
    found = program.iterate(outcome.x)
    attempt = _attempt(stage, found.controls, outcome, built - began, solved - built, avoiding.slacks)
    return attempt, found


def _attempt(stage: Stage, controls: Floats, outcome: Outcome, built: float, solved: float, pairs: int) -> Attempt:
    """A solution with what it is worth."""
    value, middle = with_middle(stage.problem, controls)
    how = outcome.status, outcome.message, outcome.iterations
    return Attempt(controls, value, stage.truncation, *how, built, solved, pairs, middle)


def _stands(stage: Stage, attempt: Attempt) -> tuple[bool, bool, float, float]:
    """Sorting key: controls of the middle member under which it does not do the task come last."""
    alone = len(stage.truncation.nodes) == 1
    return (alone and not middle_does(attempt), *rank(attempt))
