"""How polynomials behave under different distributions of a parameter."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.moments import Beta, Distribution, Samples, TruncatedNormal, nodes_to_bernstein
from printed.table import Rows, Table, header, load, plain

Floats = NDArray[np.float64]
MEASURED = "distributions/measured"
ORDER = 8
DRAWS = 50
"""Sets of values drawn from a normal distribution."""
FARTHER = 8.0
"""How many times as far out the outlier is as the farthest of the other values."""


def node_rows(problems: tuple[str, ...]) -> Rows:
    """The Lebesgue constant of each distribution's Gauss nodes, and the row sums of the matrix to Bernstein points."""
    (measured,) = load(problems[0]).fleet.parameters.values()
    normal, clusters = (TruncatedNormal(-1, 1, 0, width) for width in (0.3, 0.05)), _clusters()
    wide, narrow = normal
    distributions: dict[str, Distribution] = {
        "uniform (Legendre's nodes)": ec.Interval(-1, 1),
        f"`configs/{MEASURED}.yaml`": measured,
        "normal, deviation 0.3 half-widths": wide,
        "Beta(2, 5)": Beta(-1, 1, 2, 5),
        "two clusters of 30 measured values": clusters,
        "normal, deviation 0.05 half-widths": narrow,
    }
    return [
        {"distribution": name, "interpolation": lebesgue(distribution), "points": to_points(distribution)}
        for name, distribution in distributions.items()
    ]


def _clusters() -> Samples:
    """Two kinds of robots."""
    rng = np.random.default_rng(0)
    return Samples(np.concatenate([rng.normal(middle, 0.005, 30) for middle in (0.92, 1.08)]))


def lebesgue(distribution: Distribution) -> float:
    """The largest factor by which an error at the nodes grows in between."""
    nodes = distribution.basis(ORDER).nodes
    s = np.linspace(-1, 1, 20_001)
    factors = [np.prod([(s - b) / (a - b) for b in np.delete(nodes, i)], axis=0) for i, a in enumerate(nodes)]
    return float(np.abs(factors).sum(axis=0).max())


def to_points(distribution: Distribution) -> float:
    """The largest factor by which an error at the nodes grows in a Bernstein point."""
    return float(np.abs(nodes_to_bernstein(distribution.basis(ORDER))).sum(axis=1).max())


def node_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header(f"distribution, order {ORDER}", "interpolation, its nodes", "its nodes to Bernstein points")
    for row in rows:
        yield f"| {row['distribution']} | {plain(row['interpolation'])} | {plain(row['points'])} |"


def order_rows(problems: tuple[str, ...]) -> Rows:
    """The highest orders whose inner products over measured values are right."""
    drawn = [np.random.default_rng(seed).normal(1.0, 0.03, 60) for seed in range(DRAWS)]
    sets = {
        "60 evenly spaced": [np.linspace(0.9, 1.1, 60)],
        "60 of a normal distribution": drawn,
        "the same, and one value eight times as far out": [_with_outlier(values) for values in drawn],
    }
    return [{"values": name, **_orders(values)} for name, values in sets.items()]


def _with_outlier(values: Floats) -> Floats:
    """The values and one far from them."""
    return np.append(values, 1.0 + FARTHER * np.abs(values - 1.0).max())


def _orders(sets: list[Floats]) -> dict[str, int]:
    """The least and the largest of several sets."""
    orders = [Samples(values).max_order for values in sets]
    return {"least": min(orders), "most": max(orders)}


def order_lines(rows: Rows) -> Iterator[str]:
    """A line each, and what holds for few values."""
    yield from header("values", "`max_order`")
    for row in rows:
        least, most = row["least"], row["most"]
        yield f"| {row['values']} | {least if least == most else f'{least} to {most}'} |"
    yield "| n different ones, few | n − 1 |"


TABLES = {
    "nodes": Table("docs/distributions.md", (MEASURED,), node_rows, node_lines),
    "orders": Table("docs/distributions.md", (MEASURED,), order_rows, order_lines),
}
