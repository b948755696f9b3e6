"""The planning problem as frozen data: a fleet, a horizon, a map, a task and what to minimise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import Formula
from ensemble_ctrl.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.systems import Unicycle

Floats = NDArray[np.float64]
Guarantee = Literal["moment", "nodes", "hull"]
Method = Literal["nlp", "minlp"]

MAX_ORDER = 50
"""Largest truncation order a problem may ask for."""


def frozen(values: Any, shape: tuple[int, ...], what: str) -> Floats:
    """A read-only float copy of `values`, checked for shape and finiteness."""
    array = np.array(values, dtype=float)
    if array.shape != shape:
        raise ProblemError(f"{what}: expected {shape} numbers, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ProblemError(f"{what}: expected finite numbers, got {array.tolist()}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class Fleet:
    """The ensemble: shared dynamics, the parameter that differs, where all members start, and their limits.

    Parameters
    ----------
    system : Unicycle
        The dynamics all members share.
    parameter : Interval
        Range of the parameter, dimensionless.
    position : array_like, shape (2,)
        Common start position in metres.
    heading : float
        Common start heading in radians, counted from +x counter-clockwise whatever the system's own convention.
    input_lower, input_upper : array_like, shape (2,)
        Bounds of the commands (m/s and rad/s for a unicycle).
    radius : float
        Radius of a robot in metres; obstacles grow by it.
    parameter_name : str
        What the parameter is called in a problem file.
    """

    system: Unicycle
    parameter: Interval
    position: Floats
    heading: float
    input_lower: Floats
    input_upper: Floats
    radius: float = 0.0
    parameter_name: str = "traction"

    def __post_init__(self) -> None:
        for name in ("position", "input_lower", "input_upper"):
            object.__setattr__(self, name, frozen(getattr(self, name), (2,), f"fleet.{name}"))
        if not np.isfinite([self.heading, self.radius]).all() or self.radius < 0:
            raise ProblemError(f"fleet: expected a finite heading and a radius >= 0, got {self.heading}, {self.radius}")
        if (self.input_lower > self.input_upper).any():
            raise ProblemError(f"fleet.input_bounds: low above high: {self.input_lower}, {self.input_upper}")

    @property
    def own_heading(self) -> float:
        """Start heading in radians in the system's own convention."""
        return self.heading if self.system.heading_from == "x" else np.pi / 2 - self.heading


@dataclass(frozen=True, eq=False)
class Objective:
    r"""What the plan trades off, ``eq:WayPointObsAvoid`` with weights; smaller cost is better.

    .. math:: -w_\rho\,\rho + w_T \|\tilde m(T) - \tilde m_F\|^2 + w_u \int v^2 + \omega^2\, dt

    Parameters
    ----------
    robustness : float
        Weight of the task's robustness, per metre.
    target : array_like of shape (2,), optional
        Desired final position in metres; without it there is no terminal term.
    terminal : float
        Weight of the terminal moment error, per square metre.
    effort : float
        Weight of the control effort.
    """

    robustness: float = 1.0
    target: Floats | None = None
    terminal: float = 10.0
    effort: float = 0.1

    def __post_init__(self) -> None:
        if self.target is not None:
            object.__setattr__(self, "target", frozen(self.target, (2,), "objective.terminal.target"))
        weights = [self.robustness, self.terminal, self.effort]
        if not np.isfinite(weights).all() or min(weights) < 0:
            raise ProblemError(f"objective: expected finite weights >= 0, got {weights}")


@dataclass(frozen=True)
class SolveOptions:
    """How to solve.

    Parameters
    ----------
    method : {"nlp", "minlp"}
        ``nlp``: nonlinear programs with IPOPT.  ``minlp``: the same first; then the facets of the obstacles are chosen
        anew with binaries and Bonmin, and the best certified plan is kept.
    guarantee : {"moment", "nodes", "hull"}
        For whom the program's constraints hold. ``moment``: the paper's rows on moments, necessary only, in effect the
        mean robot. ``nodes``: the robots at the Gauss nodes, at the grid times. ``hull``: every member of the truncated
        model, through whole step intervals.
    time_limit : float
        Seconds after which the best plan so far is returned.
    seed : int
        Seed of every random draw (replayed members).
    margin : float
        Metres that the program keeps to spare: from obstacles beyond the robot's radius, and in the task's robustness.
    routes : int
        How many geometric routes are tried before the best is refined.
    max_iterations : int
        Iterations of one solve.
    """

    method: Method = "nlp"
    guarantee: Guarantee = "hull"
    time_limit: float = 600.0
    seed: int = 0
    margin: float = 0.01
    routes: int = 2
    max_iterations: int = 300


@dataclass(frozen=True)
class VerifyOptions:
    """How a plan is checked.

    Parameters
    ----------
    members : int
        Robots that are replayed.
    substeps : int
        How many times a step each is looked at.
    certificate : bool
        Whether to prove the plan for every parameter and instant, and to tighten it until that succeeds.
    """

    members: int = 10_000
    substeps: int = 1
    certificate: bool = True


@dataclass(frozen=True)
class ReportOptions:
    """What figures show.

    Parameters
    ----------
    twin : bool
        Whether to plan the problem's unconstrained twin too, and draw it dashed (`ensemble_ctrl.twin`).
    """

    twin: bool = False


@dataclass(frozen=True, eq=False)
class Problem:
    """One planning problem.

    Parameters
    ----------
    name : str
        Names the results folder.
    fleet : Fleet
        Who moves.
    duration : float
        Horizon in seconds.
    steps : int
        Number of control steps; each lasts ``duration / steps``.
    task : Formula
        What every member has to do.
    regions : mapping of str to Polyhedron
        Named areas the task speaks of.
    obstacles : mapping of str to tuple of Obstacle
        Named obstacles, each a union of convex pieces.
    objective : Objective
        What to trade off.
    order : int or None
        Truncation order N (moments 0..N); None chooses it from the accuracy needed.
    solve : SolveOptions
        How to solve.
    verify : VerifyOptions
        How to check.
    report : ReportOptions
        What to show.

    Raises
    ------
    ProblemError
        With every finding of `ensemble_ctrl.checks.findings` that is an error.
    """

    name: str
    fleet: Fleet
    duration: float
    steps: int
    task: Formula
    regions: Mapping[str, Polyhedron] = field(default_factory=dict)
    obstacles: Mapping[str, tuple[Obstacle, ...]] = field(default_factory=dict)
    objective: Objective = field(default_factory=Objective)
    order: int | None = None
    solve: SolveOptions = field(default_factory=SolveOptions)
    verify: VerifyOptions = field(default_factory=VerifyOptions)
    report: ReportOptions = field(default_factory=ReportOptions)

    def __post_init__(self) -> None:
        from ensemble_ctrl.checks import require_sound

        object.__setattr__(self, "regions", MappingProxyType(dict(self.regions)))
        object.__setattr__(self, "obstacles", MappingProxyType(dict(self.obstacles)))
        require_sound(self)

    @property
    def step(self) -> float:
        """Length of a control step in seconds."""
        return self.duration / self.steps

    @property
    def times(self) -> Floats:
        """Grid times in seconds, shape (steps + 1,)."""
        return np.linspace(0.0, self.duration, self.steps + 1)

    @property
    def pieces(self) -> tuple[tuple[str, Obstacle], ...]:
        """Every convex piece of every obstacle with the obstacle's name."""
        return tuple((name, piece) for name, pieces in self.obstacles.items() for piece in pieces)

    def with_(self, **changes: Any) -> Problem:
        """A copy with some fields replaced, checked like a new problem."""
        return replace(self, **changes)

    def __repr__(self) -> str:
        order = "auto" if self.order is None else self.order
        p = self.fleet.parameter
        return (
            f"Problem({self.name!r}: {self.fleet.system.name}, {self.fleet.parameter_name} {p.lower:g}..{p.upper:g}, "
            f"{self.duration:g} s in {self.steps} steps, order {order}, {len(self.obstacles)} obstacles, "
            f"task {self.task})"
        )

    def _repr_html_(self) -> str:
        from html import escape

        from ensemble_ctrl.drawing import map_svg

        return f"<div>{map_svg(self)}<pre>{escape(repr(self))}</pre></div>"
