r"""Rows of the program about headings, speeds, turn rates and commands of robots on arcs.

A member of coefficients ``(a, b, g)`` has the heading ``g + b Omega_n`` at grid time n, and in step n the speed
``a v_n`` and the turn rate ``b omega_n``.  A predicate over these is affine in the member, so that it holds for all
members where it holds for the corners of their box: each is one row on the turn and the commands.  A grid time is read
with the commands of both steps that it is an end of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SignalRow:
    """``turn Omega + speed v + rate omega + first u_0 + second u_1 + offset`` at grid time `at`, commands of `step`."""

    at: int
    step: int
    turn: float
    speed: float
    rate: float
    first: float
    second: float
    offset: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """Coefficients and offset."""
        return self.turn, self.speed, self.rate, self.first, self.second, self.offset


@dataclass(frozen=True, eq=False)
class Commanded:
    """Rows about the signals of a fleet on arcs.

    Parameters
    ----------
    problem : Problem
    layout : Layout
        Where turn and commands stand.
    controls : ndarray, shape (steps, 2)
        Of the guess.
    """

    problem: Problem
    layout: Layout
    controls: Floats

    @property
    def names(self) -> tuple[str, ...]:
        """What rows can be about."""
        return tuple(self.problem.fleet.system.signals)

    def reads(self, coefficients: Mapping[str, float]) -> bool:
        """Whether a predicate is about these signals alone."""
        return all(name in self.names for name in coefficients)

    @cached_property
    def _kinds(self) -> list[tuple[float, float, float]]:
        """The different ``(a, b, g)`` at the corners of the ranges."""
        corners = self.problem.fleet.coefficients(self.problem.fleet.corners)[:, :3]
        a, b, g = np.unique(corners, axis=0).T.tolist()
        return list(zip(a, b, g, strict=True))

    def rows(self, coefficients: Mapping[str, float], offset: float, at: int) -> tuple[SignalRow, ...]:
        """The rows of a normalised predicate at a grid time."""
        arcs = self.problem.fleet.arcs
        heading, v, omega = (coefficients.get(name, 0.0) for name in ("heading", "v", "omega"))
        known = ("heading", "v", "omega")
        first, second = (0.0 if name in known else coefficients.get(name, 0.0) for name in arcs.controls)
        ahead = arcs.heading_from == "x"
        sign, zero = (1.0, 0.0) if ahead else (-1.0, np.pi / 2)
        last = self.layout.steps - 1
        rates = any((v, omega, first, second))
        steps = sorted({max(at - 1, 0), min(at, last)}) if rates else [min(at, last)]
        found = dict[SignalRow, None]()
        for a, b, g in self._kinds:
            # heading s (g + b Omega) + zero, speed a v, turn rate s b omega
            start = heading * (zero + sign * g) + offset
            for n in steps:
                row = SignalRow(at, n, sign * b * heading, a * v, sign * b * omega, first, second, start)
                found[row] = None
        return tuple(found)

    @cached_property
    def _turned(self) -> Floats:
        """Omega at the grid times under the guess."""
        omega = self.problem.fleet.arcs.rates(*self.controls.T)[1]
        return np.concatenate([[0.0], np.cumsum(omega) * self.problem.duration / len(self.controls)])

    def value(self, row: SignalRow) -> float:
        """What a row is worth under the guess."""
        command = self.controls[row.step]
        v, omega = self.problem.fleet.arcs.rates(*command)
        return float(np.dot(row.numbers, [self._turned[row.at], v, omega, *command, 1.0]))

    def blocks(self, rows: list[tuple[int, SignalRow]]) -> list[Block]:
        """``row - level >= 0`` for pairs of a level and a row."""
        arcs, layout = self.problem.fleet.arcs, self.layout

        def build(z: ca.SX, d: ca.SX) -> ca.SX:
            # turn Omega + speed v + rate omega + first u_0 + second u_1 + offset - level
            v, omega = arcs.rates(z[1], z[2], CasadiArrays)
            height: ca.SX = d[0] * z[0] + d[1] * v + d[2] * omega + d[3] * z[1] + d[4] * z[2] + d[5] - z[3]
            return height

        at, step, level = np.array([(row.at, row.step, level) for level, row in rows]).T
        columns = np.column_stack([layout.turned[at], layout.controls[step], level])
        data = np.array([row.numbers for _, row in rows])
        return [Block("task", build, columns, data, np.zeros((len(rows), 1)), np.full((len(rows), 1), np.inf))]
