"""Names of an earlier version that still work for one release, with a warning that names the new one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ensemble_ctrl.core.renamed import warn_renamed
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.problem import Problem


def _ode_fleet(
    system: Any,
    parameters: Mapping[str, Any],
    start: Any = None,
    input_lower: Any = None,
    input_upper: Any = None,
    radius: Any = 0.0,
    rate_bounds: Any = None,
) -> Fleet:
    """A fleet by the order of arguments that ``OdeFleet`` had."""
    more = {"input_lower": input_lower, "input_upper": input_upper, "radius": radius, "rate_bounds": rate_bounds}
    return Fleet(system, parameters, start=start, **more)


RENAMED: Mapping[str, tuple[str, Callable[..., Any]]] = {
    "OdeFleet": ("Fleet", _ode_fleet),
    "OdeProblem": ("Problem", Problem),
}
"""Each old name with the new one and what it still is."""


def renamed(name: str) -> Callable[..., Any]:
    """The object of an old name, with a warning."""
    new, what = RENAMED[name]
    warn_renamed(f"ensemble_ctrl.{name}", f"ensemble_ctrl.{new}", depth=2)
    return what
