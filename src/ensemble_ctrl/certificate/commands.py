r"""Headings, speeds, turn rates and commands of the members of a cell, at every instant.

With coefficients ``(a, b, g)`` a member has the heading ``g + b Omega(t)``, the speed ``a v_n`` and the turn rate
``b omega_n``.  Under fixed commands a predicate over these is affine in the parameters, and linear in time within a
piece: on a cell it is its value at the centre plus and minus ``sum_k half_k |slope_k|`` at both ends of the piece,
without remainder.  Where two steps meet, a rate has the values of both, and a bound is that of the worse.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.disturbance import UNIT, signal_errors
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.instants import Mesh
from ensemble_ctrl.constraints.stl.leaves import Within
from ensemble_ctrl.constraints.stl.rewrite import leaves
from ensemble_ctrl.problem.signals import angle_range

if TYPE_CHECKING:
    from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Commands:
    """What the members of a flow do besides moving, over the pieces of its mesh.

    Attributes
    ----------
    flow : Flow
        On the mesh.
    values : mapping of str to ndarray of shape (pieces,)
        `v` and `omega` of a member with factors of 1, and each command.
    errors : mapping of str to ndarray of shape (pieces,)
        By how much each of `values`, and `heading` in radians, of a robot may be off from its member's; infinite where
        that is not known.
    unknown : frozenset of str
        Angles that turn further than a task took into account that reads them whole turns aside.
    """

    flow: Flow
    values: Mapping[str, Floats]
    errors: Mapping[str, Floats]
    unknown: frozenset[str] = frozenset()

    @classmethod
    def of(cls, problem: Problem, controls: Floats, coarse: Flow, fine: Flow, mesh: Mesh) -> Commands:
        """Those of a plan, whose flow has its own steps in `coarse`, and the pieces of `mesh` in `fine`."""
        # of the piece after the end, an instant of rounding, the last step's
        some = np.minimum(mesh.owner, coarse.steps - 1)
        names = problem.fleet.system.controls
        values = dict(zip(names, controls.T, strict=True)) | {"v": coarse.v, "omega": coarse.omega}
        widest = coarse.fastest, coarse.sharpest, coarse.strays
        errors = signal_errors(problem, controls, float(coarse.step.max()), *widest)
        return cls(
            fine,
            {name: value[some] for name, value in values.items()},
            {name: error[some] for name, error in errors.items()},
            frozenset(_beyond(problem, coarse, values, errors["heading"])),
        )

    def reads(self, coefficients: Mapping[str, float]) -> bool:
        """Whether a predicate is about these signals alone, and all that was written about them is in it."""
        return coefficients.keys() <= {"heading", *self.values} - self.unknown

    def bounds(
        self, coefficients: Mapping[str, float], offset: float, centres: Floats, half: Floats, upper: bool
    ) -> tuple[Floats, Floats]:
        """Lower bounds (or upper ones) of a predicate on the cells ``centres +- half``.

        Returns
        -------
        between : ndarray, shape (cells, pieces)
            Throughout each piece.
        ends : ndarray, shape (cells, pieces + 1)
            At the instants between them.

        Notes
        -----
        *Guarantee*: lower bounds are of every robot within the bounds of its model's errors, upper bounds of those that
        follow their model.
        """
        flow, sign = self.flow, 1.0 if upper else -1.0
        turns = np.stack([flow.turned, flow.turned + flow.step * flow.omega])
        value, slope, size = self._affine(coefficients, offset, centres, turns)
        # value(centre) -+ sum_k half_k |d value / d q_k| at both ends of each piece, for it is linear in between
        reach = np.einsum("ck,epk->cep", half, np.abs(slope))
        wrong = 4 * UNIT * (flow.steps + 64) * size
        each = value + sign * (reach + wrong)
        if not upper:
            each = each - self._errors(coefficients)
        # an instant is the end of one piece and the beginning of the next: the worse of both
        pick = np.maximum if upper else np.minimum
        begins, ends = each[:, 0], each[:, 1]
        between = pick(begins, ends)
        before = np.concatenate([begins[:, :1], ends], axis=1)
        after = np.concatenate([begins, ends[:, -1:]], axis=1)
        return between, pick(before, after)

    def _affine(
        self, coefficients: Mapping[str, float], offset: float, centres: Floats, turns: Floats
    ) -> tuple[Floats, Floats, float]:
        """Values (cells, ends, pieces), slopes by the parameters (ends, pieces, parameters), and the size of terms."""
        flow = self.flow
        c = {name: coefficients.get(name, 0.0) for name in ("heading", *self.values)}
        # theta = zero + s (g + b Omega); the turn rate has the same sign
        sign, zero = (-1.0, np.pi / 2) if flow.swapped else (1.0, 0.0)
        turn = sign * (c["heading"] * turns + c["omega"] * self.values["omega"])
        speed = c["v"] * self.values["v"] + np.zeros_like(turns)
        same = sum(
            (c[name] * value for name, value in self.values.items() if name not in ("v", "omega")),
            np.zeros_like(self.values["v"]),
        )
        # value = speed a + turn b + s c g + rest, where (a, b, g) are affine in the parameters
        a, b, g = np.moveaxis(flow.coefficients(centres)[:, None, None, :3], -1, 0)
        rest = c["heading"] * zero + offset
        value = speed * a + turn * b + (sign * c["heading"]) * g + (same + rest)
        D = flow.directions
        slope = speed[..., None] * D[:, 0] + turn[..., None] * D[:, 1] + sign * c["heading"] * D[:, 2]
        # |origin| + sum |q| |direction| bounds the terms of a coefficient, also where they cancel
        ends = np.abs(flow.origin) + np.maximum(np.abs(flow.lower), np.abs(flow.upper)) @ np.abs(flow.directions)
        largest = np.abs(speed).max(initial=0.0) * ends[0] + np.abs(turn).max(initial=0.0) * ends[1]
        heading = abs(c["heading"]) * (ends[2] + 2 * np.pi)
        return value, slope, float(largest + heading + np.abs(same).max(initial=0.0) + abs(offset))

    def _errors(self, coefficients: Mapping[str, float]) -> Floats:
        """By how much the model's errors may lower a predicate in each piece."""
        used = [(abs(value), self.errors[name]) for name, value in coefficients.items()]
        return np.asarray(sum((value * error for value, error in used), np.zeros(self.flow.steps)))


def _beyond(problem: Problem, flow: Flow, values: Mapping[str, Floats], error: Floats) -> Iterator[str]:
    """Angles read by `Within` that may leave the range for which its whole turns were written out.

    With commands beyond the input bounds, or ranges of parameters beyond the fleet's, a turn may be missing.
    """
    for name in {leaf.state for leaf in leaves(problem.specification.task) if isinstance(leaf, Within)}:
        low, high = angle_range(problem, name)
        if name == "heading":
            # own headings |g + b Omega - g_0| from the middle of the start, both ways of counting alike
            ends = flow.coefficients(flow.corners)
            turn = float(np.abs(np.append(flow.turned, flow.turned[-1] + flow.step[-1] * flow.omega[-1])).max())
            reach = float(np.abs(ends[:, 1]).max()) * turn + float(error.max())
            start = np.pi / 2 - ends[:, 2] if flow.swapped else ends[:, 2]
            seen = float(start.min()) - reach, float(start.max()) + reach
        else:
            seen = float(values[name].min()), float(values[name].max())
        if not low <= seen[0] <= seen[1] <= high:
            yield name
