"""The best controls found and how they were found."""

from __future__ import annotations

from dataclasses import field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.candidates import Tried
from ensemble_ctrl.ocp.mixed import Round
from ensemble_ctrl.ocp.rounds import Attempt
from ensemble_ctrl.planning.planner.proving import is_proven
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

Status = Literal["planned", "infeasible", "limit", "interrupted"]


@dataclass(frozen=True, eq=False)
class Solution:
    """The best controls found and how they were found.

    Attributes
    ----------
    problem : Problem
        What was asked.
    controls : ndarray, shape (steps, n_u)
        The broadcast commands.
    status : {"planned", "infeasible", "limit", "interrupted"}
        ``planned``: the program's own constraints hold; whether every member is safe is for replay to say.
    attempt : Attempt
        The last solve with its value.
    routes : tuple of Tried
        The routes tried, shortest first.
    seconds : dict of str to float
        Time of each phase.
    iterations, build_seconds, solve_seconds
        Work of all solves together.
    certificate : Certificate or None
        What is proven of the controls, if the problem asks for it.
    nlp : Attempt or None
        With ``method: minlp``, the plan that it started from.
    rounds : tuple of Round
        With ``method: minlp``, what was tried since.
    missing : tuple of str
        Optional libraries that are not installed and would have given more guesses, where there is no good plan.
    closed : tuple of str
        Regions that no passage leads to, where the search ended by that (`ensemble_ctrl.ocp.guesses.passages`).
    """

    problem: Problem
    controls: Floats
    status: Status
    attempt: Attempt
    routes: tuple[Tried, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    build_seconds: float = 0.0
    solve_seconds: float = 0.0
    certificate: Certificate | None = None
    nlp: Attempt | None = None
    rounds: tuple[Round, ...] = ()
    missing: tuple[str, ...] = ()
    closed: tuple[str, ...] = ()


def status_of(search: Search, attempt: Attempt, certificate: Certificate | None) -> Status:
    """What became of the search: rates of the commands are kept by the program, all else by it or by proof."""
    if search.stopped:
        return "interrupted"
    keeps = attempt.value.keeps(0.0) or (is_proven(certificate) and attempt.value.excess <= 0)
    if keeps and attempt.status == "solved":
        return "planned"
    if search.left() <= 0 or (attempt.status == "limit" and not keeps):
        return "limit"
    return "planned" if keeps else "infeasible"
