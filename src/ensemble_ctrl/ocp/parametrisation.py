"""What stands for the commands and the fleet in a program: a choice of variables, by protocol, in one registry.

Rows (`ensemble_ctrl.ocp.rows`, `ensemble_ctrl.ocp.task`) speak of commands, points and levels.  A parametrisation says
where they stand, what follows from what, and where to start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.cost import Scale
from ensemble_ctrl.ocp.layout import Numbers
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Iterate:
    """Commands, and where they are needed the states of the node robots under them, or near them.

    Attributes
    ----------
    controls : ndarray, shape (steps, n_u)
    states : ndarray, shape (steps + 1, n_x, nodes), optional
        Empty if not given.
    substeps : int
        Integration steps in a step of control.
    """

    controls: Floats
    states: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))
    substeps: int = 1


class Parametrisation(Protocol):
    """A choice of variables around a guess."""

    @property
    def layout(self) -> Numbers:
        """Where they stand; hands out what rows need besides."""

    @property
    def scale(self) -> Scale:
        """How commands are scaled."""

    @property
    def slack_weight(self) -> float:
        """Weight of a unit of slack."""

    @property
    def dependent(self) -> Ints:
        """The variables that `dynamics` determines from the others."""

    @property
    def names(self) -> tuple[str, ...]:
        """What predicates may call the fleet's coordinates, in the order of ``layout.points``."""

    @property
    def position_columns(self) -> Any:
        """Which columns of ``layout.points`` are positions: an index, one coordinate after the other."""

    @property
    def places(self) -> Floats | None:
        """Matrix from a coordinate's variables to the fleet's points; None where they are the points."""

    @property
    def shift(self) -> Floats:
        """Half the sides of the box by which starts differ, for each coordinate: predicates hold for all of it."""

    @property
    def curve(self) -> Floats:
        """The variables of the fleet under the guess, shape (steps + 1, count, coordinates)."""

    @property
    def bodies(self) -> Any:
        """What makes rows of bodies (`ensemble_ctrl.ocp.bodies.BodyRows`); None where robots are points."""

    def bulge(self, commands: ca.SX) -> Any:
        """Metres by which a member leaves its chord within a step, an expression of the scaled commands, or 0."""

    def dynamics(self) -> list[Block]:
        """Rows by which each time follows from the last."""

    def bound(self, lower: Floats, upper: Floats) -> None:
        """Write the bounds of its own variables."""

    def start(self, x: Floats) -> None:
        """Write its own variables under the guess."""

    def iterate(self, x: Floats) -> Iterate:
        """What a decision vector stands for, commands within their bounds."""


Make = Callable[[Problem, Truncation, Iterate], Parametrisation]
"""The parametrisation of a problem around a guess."""


@dataclass(frozen=True)
class Entry:
    """A parametrisation in the registry.

    Attributes
    ----------
    name : str
    accepts : callable
        Whether it can stand for a problem's fleet.
    make : callable
    """

    name: str
    accepts: Callable[[Problem], bool]
    make: Make


PARAMETRISATIONS: dict[str, Entry] = {}
"""By name; of those that accept a problem, the one registered last is taken."""


def register(entry: Entry) -> None:
    """Add a parametrisation, or replace the one of that name."""
    PARAMETRISATIONS.pop(entry.name, None)
    PARAMETRISATIONS[entry.name] = entry


def parametrise(problem: Problem, truncation: Truncation, guess: Iterate) -> Parametrisation:
    """Variables for a problem around a guess."""
    entry = next(entry for entry in reversed(PARAMETRISATIONS.values()) if entry.accepts(problem))
    return entry.make(problem, truncation, guess)
