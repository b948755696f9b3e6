"""Improve a plan by choosing facets anew: its own facets fixed, then branch and bound among neighbouring choices.

A *neighbourhood* of a plan says, for every convex piece and step, which facets may be chosen.  With one facet each the
program is an NLP and gives an incumbent at once; with more, Bonmin chooses, and looks only for what costs less.  A
result is polished with separating hyperplanes, of which facets are a special case, and is worth what `evaluate` says,
like any other plan.

*Guarantee*: none of optimality.  Bonmin's bound holds among the offered facets only, and even there only if every
node's local solution is its best one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.chance import map_size
from ensemble_ctrl.ocp.evaluate import evaluate
from ensemble_ctrl.ocp.facet_binaries import Choice, Facets, facet_binaries, facets, workspace
from ensemble_ctrl.ocp.guesses.drive import follow, smoothed
from ensemble_ctrl.ocp.hyperplanes import REACH
from ensemble_ctrl.ocp.linear_facets import linear_facets
from ensemble_ctrl.ocp.rounds import Attempt, improve, start
from ensemble_ctrl.ocp.solvers import Outcome, SolverOptions, Status, Watch, solve
from ensemble_ctrl.ocp.transcription import Iterate, Transcription, transcribe
from ensemble_ctrl.ocp.truncation import Truncation, points, tail
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Options = Callable[[], SolverOptions]
"""The options of the next solve; their time limit is what is left of the whole."""

HOLDS = 1e-6
"""Metres by which a facet may be missed and still counts as held."""
FACET_SLACK = 1e-4
"""Metres of slack beyond which a solution does not keep its facets."""
BETTER = 1e-3
"""By how much less a solution of Bonmin's has to cost."""
POLISH = 3
"""Rounds of separating hyperplanes after each change of facets."""
ENOUGH = 7.0
"""Seconds of choosing facets after which no further neighbourhood is searched, however much of the limit is left."""
LEAST = 0.5
"""Seconds below which no further solve is begun."""
TURN = 20
"""Parts of the horizon by which the change from one facet to the next may move."""
BLOCKS = 80
"""On a finer grid neighbouring steps share their binaries, to about so many blocks."""


@dataclass(frozen=True, eq=False)
class Round:
    """One neighbourhood, solved.

    Attributes
    ----------
    name : str
        Which neighbourhood.
    attempt : Attempt or None
        The polished result, None if the round found nothing.
    status, message : str
        How the solver ended.
    cost : float
        As `evaluate` counts it, of the result before it was polished; infinite if there is none.
    binaries, nodes : int
        Binaries of the program, and Bonmin's nodes.
    objective, bound : float
        Of the program, whose smooth robustness and slacks make it differ from `cost`; Bonmin's bound, minus infinity
        without one.
    seconds : float
        Wall clock.
    kept : bool
        Whether the plan was certified no worse than the one before and took its place.
    """

    name: str
    attempt: Attempt | None
    status: Status
    message: str
    cost: float = np.inf
    binaries: int = 0
    nodes: int = 0
    objective: float = np.inf
    bound: float = -np.inf
    seconds: float = 0.0
    kept: bool = False

    @property
    def gap(self) -> float:
        """``(objective - bound) / |objective|``, not negative; infinite where Bonmin gives no bound."""
        if not np.isfinite([self.objective, self.bound]).all():
            return np.inf
        return max(0.0, self.objective - self.bound) / max(abs(self.objective), 1e-9)


@dataclass(eq=False)
class _Search:
    """One search around a plan.

    `centre` is the plan on the coarse grid around which facets are chosen, `objective` what Bonmin has to beat, and
    `plan` the NLP's plan, whose grid and order a result is polished on.
    """

    problem: Problem
    options: Options
    watch: Callable[[str], Watch | None]
    plan: Attempt
    sides: Facets
    centre: Attempt
    objective: float = np.inf
    began: float = field(default_factory=time.perf_counter)

    def seconds(self) -> float:
        """Since the last call."""
        before, self.began = self.began, time.perf_counter()
        return self.began - before


def rounds(
    problem: Problem, attempt: Attempt, steps: int, options: Options, watch: Callable[[str], Watch | None]
) -> Iterator[Round]:
    """Improve `attempt` round by round, for as long as the caller asks for more and there is time.

    Parameters
    ----------
    problem : Problem
        What to plan.
    attempt : Attempt
        The NLP's plan, on the grid and order to end with.
    steps : int
        Of the grid on which facets are chosen; it divides the plan's.
    options : callable
        Gives the options of the next solve; their time limit is what is left of the whole.
    watch : callable
        Gives the watcher of a phase.

    Yields
    ------
    Round
        First the separating hyperplanes chosen again, so that what they alone can do is not counted as the facets'
        merit; then the plan's own facets fixed; then Bonmin in the other `NEIGHBOURHOODS`.
    """
    began = time.perf_counter()
    better, how = attempt, problem.solve
    if how.polish:
        again = _hyperplanes(problem, attempt, options(), watch("hyperplanes chosen again"))
        better = again if _better(again, attempt) else attempt
        yield _by_hyperplanes("hyperplanes chosen again", again, began)
    sides = facets(problem, steps)
    if not sides.pieces or options().time_limit < LEAST:
        return
    search = _Search(problem, options, watch, attempt, sides, better)
    truncation = _light(attempt.truncation) if how.grid == "coarse" else attempt.truncation
    search.centre = start(problem, _averaged(better.controls, steps), truncation)
    if how.facets == "linear":
        yield _from_linear_model(search, steps)
    elif how.polish and how.grid == "coarse":
        search.centre = _hyperplanes(problem, search.centre, options(), watch("hyperplanes on the coarse grid"))
        yield _by_hyperplanes(
            "hyperplanes on the coarse grid", _polished(search, "coarse grid", search.centre), search.began
        )
    search.seconds()
    began = search.began
    for name, neighbourhood in OFFERED[how.facets].items():
        if options().time_limit < LEAST or _since(began) > ENOUGH:
            return
        yield _round(search, name, neighbourhood)


def _from_linear_model(search: _Search, steps: int) -> Round:
    """Move the centre to the path of the linear model, improved with separating hyperplanes."""
    problem, name = search.problem, "path of the linear model"
    search.seconds()
    began = search.began
    found = linear_facets(problem, min(problem.solve.bonmin_limit, search.options().time_limit))
    if not found.found:
        return Round(name, None, "failed", found.message, seconds=found.seconds)
    along = start(problem, follow(problem, smoothed(found.fine(steps))), search.centre.truncation)
    search.centre = _hyperplanes(problem, along, search.options(), search.watch(name))
    return _by_hyperplanes(name, _polished(search, name, search.centre), began)


def held(sides: Facets, gaps: Floats, least: float) -> Bools:
    """Facets with at least that gap, and the best of each piece and step, shape (facets, steps)."""
    return (gaps >= least - HOLDS) | best(sides, gaps)


def best(sides: Facets, gaps: Floats) -> Bools:
    """The facet with the largest gap of each piece and step, shape (facets, steps)."""
    chosen = np.zeros(gaps.shape, dtype=bool)
    for piece in range(sides.pieces):
        own = np.flatnonzero(sides.piece == piece)
        # argmax over the piece's facets in each step
        chosen[own[gaps[own].argmax(axis=0)], np.arange(gaps.shape[1])] = True
    return chosen


def widened(allowed: Bools, steps: int) -> Bools:
    """What is allowed up to so many steps earlier or later is allowed too."""
    wide = allowed.copy()
    for shift in range(1, min(steps, allowed.shape[1] - 1) + 1):
        # the same facet from k steps before to k steps after
        wide[:, shift:] |= allowed[:, :-shift]
        wide[:, :-shift] |= allowed[:, shift:]
    return wide


def program(problem: Problem, attempt: Attempt, sides: Facets, allowed: Bools) -> tuple[Transcription, Choice]:
    """The program around `attempt` in which the `allowed` facets may be chosen, with its binaries."""
    # facets may be chosen for pairs within reach of the plan; binaries are shared within blocks of steps
    curve = points(problem, attempt.controls, attempt.truncation)
    where, error = workspace(problem, curve), tail(problem, attempt.controls, attempt.truncation)
    near = sides.gaps(curve)
    if problem.solve.facets != "all":
        allowed = allowed & ~sides.of(near >= REACH * map_size(problem, curve))[sides.piece]
    block = 1 if problem.solve.grid == "full" else -(-allowed.shape[1] // BLOCKS)
    rows = facet_binaries(problem, attempt.truncation, sides, where, allowed, error, block)
    choice = Choice(sides, where, rows, rows.setting(sides.gaps(curve)))
    return transcribe(problem, attempt.truncation, Iterate(attempt.controls), choice, (error, 0.0)), choice


Neighbourhood = Callable[[Facets, Floats, float], Bools]
"""``(facets, their gaps at the plan, margin) -> allowed``, shapes (facets, steps)."""


def _turns_moved(wider: int) -> Neighbourhood:
    """The facets that hold, also so many twentieths of the horizon earlier and later."""

    def allowed(sides: Facets, gaps: Floats, margin: float) -> Bools:
        return widened(held(sides, gaps, margin), max(wider, wider * gaps.shape[1] // TURN))

    return allowed


NEIGHBOURHOODS: dict[str, Neighbourhood] = {
    "facets fixed": lambda sides, gaps, margin: best(sides, gaps),
    "facets that hold": held,
    "turns moved": _turns_moved(1),
    "turns moved further": _turns_moved(3),
}
"""In the order in which they are searched; the first leaves no choice."""
OFFERED: dict[str, dict[str, Neighbourhood]] = {
    "near": NEIGHBOURHOODS,
    "all": {"all facets": lambda sides, gaps, margin: sides.active},
    "linear": {"facets of the linear model": lambda sides, gaps, margin: best(sides, gaps)},
}
"""By `SolveOptions.facets`."""


def _round(search: _Search, name: str, neighbourhood: Neighbourhood) -> Round:
    """Search one neighbourhood of the centre, and move the centre to what it finds."""
    search.seconds()
    problem, centre, sides = search.problem, search.centre, search.sides
    curve = points(problem, centre.controls, centre.truncation)
    # facets to choose from at each pair, and the program around the centre
    allowed = neighbourhood(sides, sides.gaps(curve), problem.solve.margin)
    transcription, choice = program(problem, centre, sides, allowed)
    count = choice.rows.count
    if not count and np.isfinite(search.objective):
        return Round(name, None, "solved", "nothing to choose", seconds=search.seconds())
    outcome = (_branched if count else _fixed)(search, name, transcription)
    done = Round(
        name,
        None,
        outcome.status,
        outcome.message,
        binaries=count,
        nodes=outcome.iterations if count else 0,
        bound=outcome.bound,
    )
    if not np.isfinite(outcome.cost):
        return replace(done, seconds=search.seconds())
    controls = transcription.iterate(outcome.x).controls
    value = evaluate(problem, controls, centre.truncation)
    found = replace(centre, controls=controls, value=value, status=outcome.status, message=outcome.message)
    search.centre, search.objective = found, outcome.cost
    return replace(
        done,
        attempt=_polished(search, name, found),
        cost=value.cost,
        objective=outcome.cost,
        seconds=search.seconds(),
    )


def _fixed(search: _Search, name: str, transcription: Transcription) -> Outcome:
    """Solve a program without binaries; a solution that needs slack is none."""
    outcome = solve(transcription.nlp, search.options(), search.watch(name))
    short = float(outcome.x[transcription.layout.slacks].max(initial=0.0))
    if outcome.status == "solved" and short <= FACET_SLACK:
        return outcome
    status: Status = "infeasible" if outcome.status == "solved" else outcome.status
    return replace(outcome, status=status, cost=np.inf, message=f"these facets fall short by {short:.2g} m")


def _branched(search: _Search, name: str, transcription: Transcription) -> Outcome:
    """Let Bonmin choose, without slack, for less than the incumbent's cost."""
    nlp, options = transcription.nlp, search.options()
    # slacks are fixed at 0: a choice of facets has to be feasible
    upper, guess = nlp.upper.copy(), nlp.guess.copy()
    upper[nlp.slacks] = guess[nlp.slacks] = 0.0
    limits = replace(
        options,
        solver="bonmin",
        time_limit=min(search.problem.solve.bonmin_limit, options.left / 2),
        cutoff=search.objective - BETTER,
        began=time.perf_counter(),
    )
    return solve(replace(nlp, guess=guess, upper=upper), limits, search.watch(name))


def _polished(search: _Search, name: str, attempt: Attempt) -> Attempt:
    """A result on the plan's own grid and order, improved with separating hyperplanes along any direction."""
    controls = np.repeat(attempt.controls, len(search.plan.controls) // len(attempt.controls), axis=0)
    fine = start(search.problem, controls, search.plan.truncation)
    if not search.problem.solve.polish:
        return replace(fine, status="solved", message="as returned")
    return _hyperplanes(search.problem, fine, search.options(), search.watch(f"{name}, polish"))


def _by_hyperplanes(name: str, attempt: Attempt, began: float) -> Round:
    """A round in which no facet was chosen."""
    status, message = attempt.status, attempt.message
    if status == "failed" and attempt.value.keeps(0.0):  # `improve` returns what it was given
        status, message = "solved", "nothing better"
    return Round(name, attempt, status, message, attempt.value.cost, seconds=_since(began))


def _hyperplanes(problem: Problem, attempt: Attempt, options: SolverOptions, watch: Watch | None) -> Attempt:
    """A few rounds with separating hyperplanes."""
    return improve(problem, attempt.controls, attempt.truncation, POLISH, options, watch)


def _averaged(controls: Floats, steps: int) -> Floats:
    """Mean commands on a coarser grid that divides the given one."""
    return np.asarray(controls.reshape(steps, -1, controls.shape[1]).mean(axis=1))


def _light(truncation: Truncation) -> Truncation:
    """Hulls of degree 2 choose a facet as well as others, in less time; the truncation error is in the margin."""
    if not truncation.hull or max(truncation.degrees, default=0) <= 2:
        return truncation
    lighter = tuple(min(degree, 2) for degree in truncation.degrees)
    return replace(truncation, orders=lighter, degrees=lighter)


def _since(began: float) -> float:
    """Seconds since then."""
    return time.perf_counter() - began


def _better(one: Attempt, other: Attempt) -> bool:
    """Whether one attempt keeps the constraints at a lower cost."""
    return one.value.keeps(0.0) and (one.value.cost < other.value.cost or not other.value.keeps(0.0))
