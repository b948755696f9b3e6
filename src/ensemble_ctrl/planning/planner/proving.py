"""Proof of what was found; where it falls short, another solve with more margin."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.ocp.rounds import Attempt
from ensemble_ctrl.planning.planner.grids import between, refined
from ensemble_ctrl.planning.planner.search import Search
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

CERTIFY_ROUNDS = 3
LOG = logging.getLogger(__name__)
CLOSE = 0.05
"""Metres by which an attempt may violate its task for tightening, or a finer solve, to be worth while."""


def is_proven(certificate: Certificate | None) -> bool:
    """Whether there is a certificate that says yes."""
    return certificate is not None and certificate.proven == "yes"


def certified_with_margin(
    search: Search, attempt: Attempt, tightened: Callable[[Attempt, Problem], Attempt | None]
) -> tuple[Attempt, Certificate, list[Attempt]]:
    """Certify; where that falls short, solve again with as much more margin, at most `CERTIFY_ROUNDS` times.

    `tightened` solves from an attempt with a problem of more margin; None or the same attempt where there is no time.
    """
    problem, work = search.problem, []
    certificate = search.certified(refined(attempt.controls, problem.steps))
    for _ in range(CERTIFY_ROUNDS):
        settled = certificate.proven == "yes" or bool(certificate.reason)  # no margin helps where nothing was enclosed
        if settled or not attempt.value.keeps(-CLOSE) or search.over():
            break
        # the margin grows by 1.5 times what is missing, and 1 mm
        short = max(0.0, -certificate.clearance, -certificate.robustness)
        if not np.isfinite(short):
            break
        LOG.info("%s: the proof falls short by %.3g: solving again with more margin", problem.name, short)
        more = replace(problem.solve, margin=problem.solve.margin + 1.5 * short + 1e-3)
        problem = problem.with_(
            solve=more, task=between(search.problem) if certificate.robustness < 0 else problem.task
        )
        tighter = tightened(attempt, problem)
        if tighter is None or tighter is attempt:
            break
        work.append(tighter)
        again = search.certified(refined(tighter.controls, problem.steps))
        if again.proven == "yes" or least_bound(again) > least_bound(certificate):
            attempt, certificate = tighter, again
    return attempt, certificate, work


def no_less_proven(new: Certificate | None, old: Certificate | None) -> bool:
    """Whether a certificate says at least as much as another."""
    if new is None or old is None or new.proven == "yes":
        return True
    return old.proven != "yes" and least_bound(new) >= least_bound(old)


def least_bound(certificate: Certificate) -> float:
    """The smallest bound in it; minus infinity where nothing could be said."""
    return -np.inf if certificate.reason else min(certificate.clearance, certificate.robustness)
