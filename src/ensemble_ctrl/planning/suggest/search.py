"""The smallest change of a problem for which a plan is found and certified, within some seconds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError, RunawayError
from ensemble_ctrl.ocp.guesses.passages import closed_off
from ensemble_ctrl.ocp.solvers import Iteration
from ensemble_ctrl.planning.planner import Progress, screen, solve
from ensemble_ctrl.planning.suggest.relax import Relaxation, Relaxed, relaxations, wider_bounds
from ensemble_ctrl.problem import Problem, ReportOptions
from ensemble_ctrl.problem.evaluation.conflicts import conflicts
from ensemble_ctrl.problem.evaluation.sampled import replay

Floats = NDArray[np.float64]

SECONDS = 30.0
"""How long is looked for what would help."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """A change that was tried, and helps.

    Attributes
    ----------
    change : str
        What is different, in words with the figure.
    overrides : tuple of str
        The same as ``KEY=VALUE`` for ``--set`` and `ensemble_ctrl.load`; empty where no override can say it.
    problem : Problem
        The changed problem.
    controls : ndarray, shape (steps, n_u)
        Its plan.
    certificate : Certificate
        The proof of that; `proven` is "yes".

    Notes
    -----
    *Guarantee*: the controls are a plan of the changed problem, and its certificate is what it says. That no smaller
    change would do is not proven.
    """

    change: str
    overrides: tuple[str, ...]
    problem: Problem
    controls: Floats
    certificate: Certificate


@dataclass(frozen=True, eq=False)
class Suggestions:
    """What was tried.

    Attributes
    ----------
    helps : tuple of Suggestion
        Changes of one kind that help, if any were found.
    failed : tuple of str
        The largest changes of other kinds, for which no plan was found either.
    seconds : float
        Time taken.
    limited : bool
        Whether the time was up before everything was tried: that other changes do not help is then not known.
    """

    helps: tuple[Suggestion, ...] = ()
    failed: tuple[str, ...] = ()
    seconds: float = 0.0
    limited: bool = False


def suggest(
    problem: Problem, controls: Floats, *, seconds: float = SECONDS, progress: Progress | None = None
) -> Suggestions:
    """Look for a small change of `problem` for which there is a certified plan.

    Parameters
    ----------
    problem : Problem
        For which no plan was found.
    controls : ndarray, shape (steps, n_u)
        The best guess there is; what fails under it says what is tried first.
    seconds : float
        How long to look. One relaxed solve of a large problem can take as long.
    progress : callable, optional
        As for the planner; returning True stops the search with what it has.

    Returns
    -------
    Suggestions
        The first kind of change that helps, as small as a bisection over a few strengths finds it.
    """
    search = _Search(time.perf_counter() + seconds, seconds, progress)
    if progress is not None:
        search.stopped = progress("suggest", None)
    failed: list[str] = []
    helps: list[Suggestion] = []
    try:
        ways = relaxations(problem, conflicts(problem, controls), _spread(problem, controls))
    except RunawayError:  # nothing is known of what fails
        ways = relaxations(problem, (), False)
    for way in ways:
        if search.over():
            break
        found = search.smallest(way)
        if isinstance(found, Suggestion):
            helps.append(found)
            if way.name == "horizon":
                helps += search.with_bounds(problem, found)
            break
        if found is not None:
            failed.append(found)
    return Suggestions(tuple(helps), tuple(failed), seconds - search.left(), search.left() <= 0.1 and not helps)


@dataclass(eq=False)
class _Search:
    """The clock, whom to tell, and whether to stop."""

    ends: float
    seconds: float
    progress: Progress | None
    stopped: bool = field(default=False)

    def left(self) -> float:
        """Seconds that are left."""
        return self.ends - time.perf_counter()

    def over(self) -> bool:
        """Whether to end."""
        return self.stopped or self.left() <= 0.1

    def late(self) -> bool:
        """Whether to look no further for a smaller change: the rest of the time is for the proof."""
        return self.stopped or self.left() < 0.5 * self.seconds

    def watch(self, changed: Relaxed) -> Progress:
        """Passes on what the solves of a change say, under a short name of it."""
        what = changed.change.partition(" in place")[0].partition(":")[0].partition(" (")[0]

        def watching(_: str, iteration: Iteration | None) -> bool:
            if self.progress is not None and iteration is not None:
                self.stopped = self.progress(f"try {what}", iteration) or self.stopped
            return self.stopped

        return watching

    def smallest(self, way: Relaxation) -> Suggestion | str | None:
        """The smallest strength that helps; the largest in words if it does not, None if time ran out before."""
        guesses: dict[int, Floats] = {}
        changes: dict[int, Relaxed] = {}

        def promising(k: int) -> bool:
            changed = changes[k] = way.at(way.strengths[k])
            if closed_off(changed.problem):
                return False
            quick = _quick(changed.problem, self.left())
            found = screen(quick, progress=self.watch(changed), curves=way.curves)
            if found is not None:
                guesses[k] = found
            return found is not None

        try:
            k = first_true(promising, len(way.strengths), self.late)
        except ProblemError:
            return None
        while k is not None and not self.over():
            found = self._certified(changes[k], guesses.get(k))
            if found is not None:
                return found
            k = min((larger for larger in guesses if larger > k), default=None)
        return None if self.over() or not changes else changes[max(changes)].change

    def with_bounds(self, problem: Problem, longer: Suggestion) -> list[Suggestion]:
        """The same path in the given time, if the input bounds are wider instead."""
        factor = longer.problem.duration / problem.duration
        try:
            changed = wider_bounds(problem, float(f"{factor:.4g}"))
        except ProblemError:
            return []
        rates = [unit.endswith("/s") for unit in problem.fleet.system.control_units]
        guess = longer.controls * np.where(rates, factor, 1.0) if problem.fleet.system.on_arcs else None
        found = None if self.over() else self._certified(changed, guess)
        return [] if found is None else [found]

    def _certified(self, changed: Relaxed, guess: Floats | None) -> Suggestion | None:
        """The change as a suggestion, if its problem is planned and certified."""
        found = solve(_quick(changed.problem, self.left()), progress=self.watch(changed), guess=guess)
        certificate = found.certificate
        if self.stopped or found.status != "planned" or certificate is None or certificate.proven != "yes":
            return None
        return Suggestion(changed.change, changed.overrides, changed.problem, found.controls, certificate)


def first_true(holds: Callable[[int], bool], count: int, late: Callable[[], bool]) -> int | None:
    """The first of 0 .. count - 1 that holds, where all after one that holds do too; None if the last does not.

    Once it is late, the first that is known to hold.

    Examples
    --------
    >>> first_true(lambda k: k >= 3, 8, lambda: False), first_true(lambda k: False, 8, lambda: False)
    (3, None)
    """
    if not holds(count - 1):
        return None
    # bisection for the first that holds
    low, high = 0, count - 1
    while low < high and not late():
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return high


def _quick(problem: Problem, seconds: float) -> Problem:
    """The problem as it is tried: certified, without what only a report needs, in the time that is left."""
    return problem.with_(
        solve=replace(problem.solve, time_limit=max(seconds, 0.1), method="nlp"),
        verify=replace(problem.verify, certificate=True),
        report=ReportOptions(),
    )


def _spread(problem: Problem, controls: Floats) -> bool:
    """Whether the robot with the middle parameters does the task that others fail."""
    fleet = problem.fleet
    if not fleet.names:
        return False
    middle = np.array([[fleet.parameters[name].center for name in fleet.names]])
    return not replay(problem, controls, parameters=middle, substeps=4).violating.any()
