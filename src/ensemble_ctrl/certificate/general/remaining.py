"""Proof that the rest of a plan is good for a robot of any system of which a box of states is known."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import Unenclosed
from ensemble_ctrl.certificate.general.proof import GeneralProof
from ensemble_ctrl.certificate.remaining import SPARE, SetCertificate
from ensemble_ctrl.constraints.stl import Known
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


def certify_box(problem: Problem, controls: Floats, spread: Floats) -> SetCertificate:
    """Prove `controls` for a box of states.

    Parameters
    ----------
    problem : Problem
        What is left: its fleet starts in the middle of the box; its time is 0 now.
    controls : ndarray, shape (steps, n_u)
        Commands of what is left.
    spread : ndarray, shape (states,)
        Half the sides of the box.

    Returns
    -------
    SetCertificate
        Not proven, and its `worst` says why, where there is no enclosure.

    Notes
    -----
    *Guarantee*: with `proven`, every member whose start is in the box does the task in dense time. The box enters as a
    jump of the error at time 0, so the theorem of ``docs/proof_systems.md`` holds as it is.
    """
    began = time.perf_counter()
    fleet = problem.fleet
    controls = fleet.checked_controls(controls)
    proof = GeneralProof(problem, controls, fleet.parameters, np.asarray(spread, dtype=float))
    try:
        clearance, nearest = _clearance(proof)
        robustness, hardest = _robustness(proof)
    except Unenclosed as error:
        return SetCertificate(False, -np.inf, -np.inf, str(error), time.perf_counter() - began)
    worst = nearest if clearance < robustness else hardest
    proven = clearance >= 0 and robustness >= 0
    return SetCertificate(proven, clearance, robustness, worst, time.perf_counter() - began)


def _clearance(proof: GeneralProof) -> tuple[float, str]:
    """Of the nearest piece of all that must be kept out of; one above `SPARE` is not sharpened."""
    found = [(np.inf, "no obstacle")]
    for avoid in proof.problem.specification.avoid:
        found.append((proof.clearance(avoid, SPARE).proven, f"avoid({avoid.name})"))
    return min(found)


def _robustness(proof: GeneralProof) -> tuple[float, str]:
    """Of the hardest part of the rest of the task."""
    found = [(np.inf, "")]
    for part in proof.problem.specification.parts:
        known = isinstance(part.formula, Known)
        value = part.formula.value if isinstance(part.formula, Known) else proof.part(part).proven
        found.append((value, str(part) if not known else "what is past"))
    return min(found)
