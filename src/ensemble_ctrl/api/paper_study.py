"""Where more moments help, and where not: violation and cost, what moments allow, and truncation, against the order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.api.paper import Form, Reproduced, Robot, as_published, experiment, heard, reproduced
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.moments import Interval, LegendreBasis
from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]

STUDIED = "five_obstacles"
"""The experiment that is planned at every order."""
STEPS, MEMBERS = 40, 10_000
"""Of its plans."""
ORDERS = tuple(range(1, 17))
BOTH: tuple[Form, ...] = ("published", "ours")
"""Forms that are studied."""
HALF_WIDTHS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Of the traction around 1, in which truncation is measured."""
DENSE = 2001
"""Scaled parameters at which the reach of moments is looked for."""


@dataclass(frozen=True, eq=False)
class Study:
    """What the study found.

    Attributes
    ----------
    planned : tuple of Reproduced
        A plan of `STUDIED` at each order in both forms; a published form that has no solution is not there.
    orders : tuple of int
        The order of each plan.
    reach : tuple of (int, float)
        For each order the largest value of a function whose moments up to it satisfy the bounds for ``|x| <= 1``.
    truncation : tuple of (float, int, float)
        Half width of the traction's range, order, and the largest distance in metres between a member and the truncated
        curve under one plan.
    """

    planned: tuple[Reproduced, ...]
    orders: tuple[int, ...]
    reach: tuple[tuple[int, float], ...]
    truncation: tuple[tuple[float, int, float], ...]


def study(orders: Sequence[int] = ORDERS, members: int = MEMBERS, progress: Progress | None = None) -> Study:
    """Plan `STUDIED` at every order in both forms, and measure what moments allow and what truncation costs.

    Parameters
    ----------
    orders : sequence of int
        Truncation orders.
    members : int
        Replayed of each plan.
    progress : callable, optional
        As for `ensemble_ctrl.plan`.
    """
    from ensemble_ctrl.ocp import parallel
    from ensemble_ctrl.ocp.solvers import Iteration, Watch

    work: list[tuple[int, Form]] = [(order, form) for order in orders for form in BOTH]

    def one(k: int, watch: Watch) -> Reproduced:
        order, form = work[k]
        problem = studied(order)
        linear = as_published(problem)
        linear = linear.with_(solve=replace(linear.solve, facets="linear"))
        what: tuple[str, Robot, Form] = (STUDIED, "unicycle", form)
        return reproduced(problem, linear if form == "published" else problem, what, members, partial(heard, watch))

    def tell(k: int, iteration: Iteration) -> bool:
        return progress is not None and progress(f"order {work[k][0]} {work[k][1]}", iteration)

    rows = parallel.each(one, len(work), tell, lambda: inf)
    found = [(row, order) for row, (order, _) in zip(rows, work, strict=True) if row is not None]
    controls = next((row.controls for row, _ in reversed(found) if row.form == "ours"), None)
    truncation = () if controls is None else tuple(truncation_errors(studied(8), controls, orders))
    return Study(
        tuple(row for row, _ in found),
        tuple(order for _, order in found),
        tuple((order, reach(order)) for order in orders),
        truncation,
    )


def studied(order: int) -> Problem:
    """The studied problem at one order, on a coarser grid."""
    return experiment(STUDIED).with_(steps=STEPS, order=order)


def reach(order: int) -> float:
    """The largest value of a function whose moments up to an order satisfy the bounds for ``|x| <= 1``.

    Parameters
    ----------
    order : int

    Returns
    -------
    float
        1 would say that the bounds keep the function within them.

    Examples
    --------
    >>> [round(reach(order), 1) for order in (0, 1, 4, 8)]
    [1.0, 2.5, 9.3, 22.1]
    """
    basis = LegendreBasis(order)
    s = np.linspace(-1.0, 1.0, DENSE)
    # |m_k| <= m_k^+ + m_k^- for |x| <= 1, so x(s) = sum_k m_k phi_k(s) reaches sum_k (m_k^+ + m_k^-) |phi_k(s)|
    bounds = np.sum(basis.signed_moments(), axis=0)
    return float((np.abs(basis.evaluate(s)) @ bounds).max())


def truncation_errors(problem: Problem, controls: Floats, orders: Sequence[int]) -> Iterator[tuple[float, int, float]]:
    """Half width of the traction around 1, order, and the largest distance of a member from the truncated curve."""
    from ensemble_ctrl.ocp.truncation import plain, tail

    for half in HALF_WIDTHS:
        wide = problem.with_(fleet=problem.fleet.with_(parameters={"traction": Interval(1 - half, 1 + half)}))
        for order in orders:
            yield half, order, tail(wide, controls, plain((order,), hull=False))


def study_data(found: Study) -> list[dict[str, Any]]:
    """The study as rows of plain data, each with its kind."""
    plans = zip(found.planned, found.orders, strict=True)
    rows: list[dict[str, Any]] = [
        {
            "kind": "plan",
            "order": order,
            **{name: value for name, value in asdict(row).items() if name in PLANNED},
        }
        for row, order in plans
    ]
    rows += [{"kind": "reach", "order": order, "value": value} for order, value in found.reach]
    rows += [{"kind": "truncation", "half_width": h, "order": n, "error": error} for h, n, error in found.truncation]
    return rows


PLANNED = ("form", "status", "cost", "members", "violating", "depth", "proven")
"""What is kept of a plan."""
