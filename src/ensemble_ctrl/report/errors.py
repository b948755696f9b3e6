"""Errors of the model in words: their bounds, and what a plan tolerates of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.terrain import crossed
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import POSITION

Floats = NDArray[np.float64]


def patch_text(patch: Patch) -> list[str]:
    """The range of each parameter in a patch of terrain."""
    return [f"{name} {low:g} to {high:g}" for name, (low, high) in patch.parameters.items()]


def terrain_rows(problem: Problem, controls: Floats) -> list[tuple[str, str]]:
    """Each patch with its ranges, and when members may be in it under a plan."""
    met = crossed(problem, controls)
    rows: list[tuple[str, str]] = []
    for name, patch in problem.terrain.items():
        when = "kept out of"
        if name in met:
            when = f"members may be in it from {met[name].begin:.1f} to {met[name].end:.1f} s"
        rows.append(("" if rows else "terrain", f"{name}, {', '.join(patch_text(patch))}: {when}"))
    return rows


def errors_text(fleet: Fleet) -> str:
    """The bounds of the errors of the model."""
    bounds, system = fleet.uncertainty, fleet.system
    units = dict(zip(system.controls, system.control_units, strict=True))
    states = {POSITION: "m", **fleet.state_units, **({system.heading_state: "rad"} if system.heading_state else {})}
    texts = [f"{name} {value:.4g} {_rate(states.get(name, ''))}".rstrip() for name, value in bounds.disturbance.items()]
    texts += [f"{name} {value:.4g} {units[name]}" for name, value in bounds.actuators.items()]
    texts += [f"{name} {100 * share:.4g} %" for name, share in bounds.shares.items()]
    texts += [f"{name} in steps of {value:.4g} {units[name]}" for name, value in bounds.quantisation.items()]
    texts += [f"{name} varies by {100 * share:.4g} %" for name, share in bounds.varies.items()]
    texts += [f"{kind} {value:g} s" for kind in ("delay", "jitter") if (value := getattr(bounds, kind))]
    held = bounds.heading_hold
    return ", ".join([*texts, *([] if held is None else [f"heading held within {held:g} s"])])


def _rate(unit: str) -> str:
    """The unit of a rate."""
    return f"{unit}/s" if unit else ""


def tolerated(found: dict[str, Any] | None) -> list[tuple[str, str]]:
    """How large a multiple of errors a plan tolerates that was to tolerate as much as can be."""
    if found is None:
        return []
    missed = "" if found["missed"] is None else f"; none found for {found['missed']:.3g} times"
    return [("tolerance", f"{found['scale']:.3g} times the errors that were given{missed} ({found['tried']} tried)")]
