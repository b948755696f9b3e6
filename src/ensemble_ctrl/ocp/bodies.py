r"""Bodies in the program: every corner of the footprint is a further curve of the fleet, exact in the lifted state.

A corner ``beta`` of a robot is at ``p + R(theta) beta``, linear in its lifted state ``(px, py, cos, sin)``.  For robots
on arcs ``theta = g + b Omega``, with one integral ``Omega`` of the turn rate for all of them: the corner curve of the
fleet is the position curve and ``C R(g_j + b_j Omega) beta`` for the Gauss-node robots j, with C their points.  A
convex body is on one side of a line exactly if all of its corners are.

Points stand in this order: the positions, then each corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.arrays import CasadiArrays
from ensemble_ctrl.ocp.hyperplanes import Hyperplanes, separate
from ensemble_ctrl.ocp.layout import Layout
from ensemble_ctrl.ocp.program import Block
from ensemble_ctrl.ocp.truncation import Truncation, node_drives
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.specification import AvoidConstraint

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def body_hyperplanes(
    problem: Problem,
    curve: Floats,
    avoid: Sequence[AvoidConstraint],
    parts: tuple[Floats, ...],
    near: float,
) -> Hyperplanes:
    """Separating hyperplanes of bodies, or of the planned points where these alone are kept out.

    Parameters
    ----------
    curve : ndarray, shape (steps + 1, points, 2)
        As `occupied` gives it.
    parts : tuple of ndarray
        For each cell the matrix from the points of one curve to its own.
    """
    body, count = problem.fleet.footprint, parts[0].shape[1]
    if body is None:
        return separate(curve, avoid, problem.duration, problem.fleet.shift, parts, near)
    corners = len(body.corners)
    # the planned points' own columns come first, then those of each corner
    alone = tuple(np.hstack([part, np.zeros((len(part), corners * count))]) for part in parts)
    all_of_it = tuple(
        np.hstack([np.zeros((corners * len(part), count)), np.kron(np.eye(corners), part)]) for part in parts
    )
    bodies = [one for one in avoid if one.footprint is not None]
    points_only = [one for one in avoid if one.footprint is None]
    found = separate(curve, bodies, problem.duration, problem.fleet.shift, all_of_it, near)
    if not points_only:
        return found
    return found.joined(separate(curve, points_only, problem.duration, problem.fleet.shift, alone, near))


@dataclass(frozen=True, eq=False)
class BodyRows:
    """Rows by which bodies keep to their side of hyperplanes, for positions of the truncated curve as variables."""

    problem: Problem
    truncation: Truncation
    layout: Layout

    def blocks(self, planes: Hyperplanes, side: Ints, at: Ints, slack: Ints, data: Floats, bulge: Any) -> list[Block]:
        """As `ensemble_ctrl.ocp.rows.avoidance_rows`, whose `data` and slacks these are."""
        layout, blocks = self.layout, []
        turned = np.stack([layout.turned[at], layout.turned[at + 1]], axis=1)
        columns = np.column_stack([layout.controls[at], slack, turned, layout.points[at], layout.points[at + 1]])
        for cell, part in enumerate(planes.parts):
            rows = planes.cell[side] == cell
            if rows.any():
                low = np.zeros((int(rows.sum()), 2 * len(part)))
                build = self._build(part, bulge)
                blocks.append(Block("avoiding", build, columns[rows], data[rows], low, low + np.inf))
        return blocks

    def _build(self, part: Floats, bulge: Any) -> Any:
        """The rows of one pair."""
        n, matrix = self.layout.count, ca.DM(part)

        def build(z: ca.SX, data: ca.SX) -> ca.SX:
            # z: v, omega, slack, Omega_begin, Omega_end, P_begin, P_end; data: n, then the levels at both ends
            short = z[2] - bulge(z[:2]) - self._turn_bulge(z[:2])
            rows = []
            for k in (0, 1):
                place = z[5 + 2 * n * k : 5 + 2 * n * (k + 1)]
                along = data[0] * place[:n] + data[1] * place[n:]
                own = [along + data[0] * dx + data[1] * dy for dx, dy in self._corners(z[3 + k])]
                rows.append(ca.mtimes(matrix, ca.vertcat(along, *own)) - data[2 + k])
            found: ca.SX = ca.vertcat(*rows) + short
            return found

        return build

    def _corners(self, turned: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """The points of each corner relative to those of the position, x and y."""
        fleet, image = self.problem.fleet, ca.DM(self.truncation.to_points)
        _, factor, heading = (ca.DM(column) for column in node_drives(self.problem, self.truncation)[:, :3].T)
        angle = heading + factor * turned
        if fleet.arcs.heading_from == "y":
            angle = np.pi / 2 - angle
        c, s = ca.cos(angle), ca.sin(angle)
        corners = [] if fleet.footprint is None else fleet.footprint.corners.tolist()
        return [(ca.mtimes(image, c * x - s * y), ca.mtimes(image, s * x + c * y)) for x, y in corners]

    def _turn_bulge(self, commands: ca.SX) -> Any:
        """Metres by which a corner leaves its chord as it turns; none unless points are hulls."""
        fleet = self.problem.fleet
        if not self.truncation.hull or fleet.footprint is None:
            return 0.0

        # |beta| (b omega dt)^2 / 8
        _, omega = fleet.arcs.rates(commands[0], commands[1], CasadiArrays)
        step = self.problem.duration / self.layout.steps
        return fleet.footprint.reach * (fleet.fastest[1] * step) ** 2 / 8 * omega**2
