"""Names of an earlier version that still work for one release, with a warning that names the new one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ensemble_ctrl.core.renamed import warn_renamed
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.problem import Problem


class _Ode(type):
    """Of a name for what is not on arcs: it has the instances that it had, and makes what stands for them today."""

    def __instancecheck__(cls, value: object) -> bool:
        fleet = value.fleet if isinstance(value, Problem) and cls is OdeProblem else value
        return isinstance(fleet, Fleet) and not fleet.system.on_arcs and (cls is OdeProblem) == (fleet is not value)

    def __call__(cls, *args: Any, **given: Any) -> Any:
        return cls.made(*args, **given)  # type: ignore[attr-defined]


class OdeFleet(metaclass=_Ode):
    """A fleet by the order of arguments that ``OdeFleet`` had."""

    @staticmethod
    def made(
        system: Any,
        parameters: Mapping[str, Any],
        start: Any = None,
        input_lower: Any = None,
        input_upper: Any = None,
        radius: Any = 0.0,
        rate_bounds: Any = None,
    ) -> Fleet:
        """The fleet."""
        more = {"input_lower": input_lower, "input_upper": input_upper, "radius": radius, "rate_bounds": rate_bounds}
        return Fleet(system, parameters, start=start, **more)


class OdeProblem(metaclass=_Ode):
    """A problem whose fleet is not on arcs."""

    made = Problem


RENAMED: Mapping[str, tuple[str, type]] = {"OdeFleet": ("Fleet", OdeFleet), "OdeProblem": ("Problem", OdeProblem)}
"""Each old name with the new one and what it still is."""


def renamed(name: str, home: str = "ensemble_ctrl") -> type:
    """The object of an old name in a package, with a warning."""
    new, what = RENAMED[name]
    warn_renamed(f"{home}.{name}", f"ensemble_ctrl.{new}", depth=2)
    return what
