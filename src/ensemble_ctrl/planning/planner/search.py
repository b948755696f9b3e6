"""One search: the clock, whom to tell, and work side by side that can be ended."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate, certify, unproven
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp import parallel
from ensemble_ctrl.ocp.candidates import Start, join_logs, part_log
from ensemble_ctrl.ocp.guesses import Request
from ensemble_ctrl.ocp.guesses.registry import Stop
from ensemble_ctrl.ocp.mixed import Round
from ensemble_ctrl.ocp.solvers import AT_WORK, Iteration, SolverOptions, Watch
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)
T = TypeVar("T")
Progress = Callable[[str, Iteration | None], bool]
"""Called with a phase and, during a solve, the iteration; returning True asks to stop."""
AFTERWARDS = 5.0
"""Seconds that a proof, and a replay, may take however little of the time limit is left."""
TOO_LATE, STOPPED = "the time limit ended the proof", "an interruption ended the proof"
"""Why a proof was not finished."""


@dataclass(eq=False)
class Search:
    """One search: the problem, whom to tell, the clock, and the best attempt so far."""

    problem: Problem
    progress: Progress | None
    log: Path | None
    began: float = field(default_factory=time.perf_counter)
    stopped: bool = False

    def left(self) -> float:
        """Seconds until the time limit."""
        return self.problem.solve.time_limit - (time.perf_counter() - self.began)

    def options(self, barrier: float, tolerance: float) -> SolverOptions:
        """Solver options within what is left of the time."""
        solve = self.problem.solve
        return SolverOptions(solve.max_iterations, self.left(), tolerance, barrier, self.log, solve.solver)

    def watch(self, phase: str) -> Callable[[Iteration], bool] | None:
        """The watcher of one phase."""
        if self.progress is None:
            return None
        progress = self.progress

        def watching(iteration: Iteration) -> bool:
            self.stopped = self.stopped or progress(phase, iteration)
            return self.stopped

        return watching

    def tell(self, phase: str) -> None:
        """Say that a phase begins."""
        LOG.debug("%s: phase %s, %.1f s left", self.problem.name, phase, self.left())
        if self.progress is not None:
            self.stopped = self.progress(phase, None) or self.stopped

    def show_candidates(self, found: Sequence[Start]) -> None:
        """Show guesses, or what became of them, to a `progress` that has a method ``candidates`` for that."""
        show = getattr(self.progress, "candidates", None)
        if show is not None:
            show(found)

    def side_by_side(self, phase: str, work: Callable[[Search, int], T], count: int) -> list[T | None]:
        """Results of `work` for each candidate, under a search of its own with the same clock; None without one."""
        if self.over():
            return [None] * count
        parts = [part_log(self.log, i) for i in range(count)]

        def own(candidate: int, watch: Watch) -> T:
            def progress(_: str, iteration: Iteration | None) -> bool:
                return iteration is not None and watch(iteration)

            return work(replace(self, progress=progress, log=parts[candidate]), candidate)

        def tell(candidate: int, iteration: Iteration) -> bool:
            where = phase if count == 1 else f"{phase} {candidate + 1}/{count}"
            self.stopped = self.stopped or (self.progress is not None and self.progress(where, iteration))
            return self.stopped

        try:
            return parallel.each(own, count, tell, self.left)
        finally:
            join_logs(self.log, parts)

    def alone(self, phase: str, work: Callable[[Search], T]) -> T | None:
        """The result of one piece of work, in the same way."""
        return self.side_by_side(phase, lambda own, _: work(own), 1)[0]

    def request(self, steps: int, best: Floats | None = None) -> Request:
        """A request for guesses, which may be made side by side."""

        def side_by_side(phase: str, work: Callable[[Stop, int], T], count: int) -> list[T | None]:
            return self.side_by_side(phase, lambda own, candidate: work(own.over, candidate), count)

        return Request(self.problem, steps, best, side_by_side=side_by_side, left=self.left)

    def certified(self, controls: Floats) -> Certificate:
        """What is proven of controls on the problem's grid in what is left of the time, and at least `AFTERWARDS`.

        A proof is made in a process that can be ended, where there is one.
        """
        ends = time.perf_counter() + max(self.left(), AFTERWARDS)

        def tell(_: Iteration) -> bool:
            self.stopped = self.stopped or (self.progress is not None and self.progress("certify", AT_WORK))
            return self.stopped

        proof = parallel.alone(lambda _: certify(self.problem, controls), tell, lambda: ends - time.perf_counter())
        found = proof or unproven(self.problem, controls, STOPPED if self.stopped else TOO_LATE)
        LOG.info("%s: certificate: %s", self.problem.name, _in_words(found))
        return found

    def reported(self, found: Round) -> None:
        """Say how a round of facets ended."""
        if self.progress is not None:
            self.progress(found.name, Iteration(found.nodes, found.objective, 0.0, found.bound))

    def over(self) -> bool:
        """Whether to stop now with what there is."""
        return self.stopped or self.left() <= 0


def _in_words(certificate: Certificate) -> str:
    """What a certificate says, in one line of the log."""
    bounds = f"clearance {certificate.clearance:.4g}, robustness {certificate.robustness:.4g}"
    return f"proven {certificate.proven}, {certificate.reason or bounds}"
