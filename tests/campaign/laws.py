"""Laws of parameters from SciPy: where their mass is, for means and for shares of the fleet."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from scipy import special, stats

from .model import Case, Floats, Law, Long, Longs, ends_of

MANY_NODES = {1: 24, 2: 14}
"""Points for each of so many parameters; else 8."""


def quantiles(law: Law, share: Floats) -> Floats:
    """The values below which these shares of the law lie."""
    match law[0]:
        case "uniform":
            return np.asarray(law[1] + share * (law[2] - law[1]))
        case "beta":
            return np.asarray(law[1] + (law[2] - law[1]) * stats.beta.ppf(share, law[3], law[4]))
        case "normal":
            return np.asarray(_normal(law).ppf(share))
        case "samples":
            values = np.sort(np.array(law[1]))
            return np.asarray(values[np.clip((share * len(values)).astype(int), 0, len(values) - 1)])
    total = sum(weight for _, weight in law[1])
    edges = np.cumsum([0.0, *(weight / total for _, weight in law[1])])
    part = np.clip(np.searchsorted(edges, share, side="right") - 1, 0, len(law[1]) - 1)
    inner = (share - edges[part]) / (edges[part + 1] - edges[part])
    return np.array([quantiles(law[1][k][0], np.array([s]))[0] for k, s in zip(part, inner, strict=True)])


def points(law: Law, count: int) -> tuple[Floats, Longs]:
    """Values and weights whose sum is the law's mean of any smooth function."""
    low, high = ends_of(law)
    match law[0]:
        case "uniform":
            x, w = special.roots_legendre(count)
        case "beta":
            x, w = special.roots_jacobi(count, law[4] - 1, law[3] - 1)
        case "normal":
            edges = np.linspace(low, high, 9)
            nodes, weights = special.roots_legendre(count)
            x = ((edges[:-1] + edges[1:])[:, None] + np.diff(edges)[:, None] * nodes).ravel() / 2
            w = np.tile(weights, 8) * _normal(law).pdf(x)
            return x, np.asarray(w.astype(Long) / w.astype(Long).sum())
        case "samples":
            return np.array(law[1]), np.full(len(law[1]), Long(1) / len(law[1]))
        case _:
            rules = [(points(part, count), weight) for part, weight in law[1]]
            total = Long(sum(Long(weight) for _, weight in law[1]))
            weights_ = [w * Long(weight) / total for (_, w), weight in rules]
            return np.concatenate([x for (x, _), _ in rules]), np.concatenate(weights_)
    w = w.astype(Long)
    return (low + high) / 2 + (high - low) / 2 * x, np.asarray(w / w.sum())


def rule(case: Case) -> tuple[Floats, Longs]:
    """Members and weights that stand for the fleet in a mean: measured robots themselves, nodes for the rest."""
    laws, cloud = case.laws, _cloud(case)
    others = [name for name in laws if name not in cloud]
    each = MANY_NODES.get(len(others), 8)
    rules = [points(laws[name], each) for name in others]
    robots = np.array([laws[name][1] for name in cloud]).T if cloud else np.zeros((1, 0))
    rows, weights = [], []
    for choice in product(*(range(len(x)) for x, _ in rules)):
        values = dict(zip(others, (x[k] for (x, _), k in zip(rules, choice, strict=True)), strict=True))
        weight = np.prod([w[k] for (_, w), k in zip(rules, choice, strict=True)], dtype=Long)
        for robot in robots:
            told = {**values, **dict(zip(cloud, robot, strict=True))}
            rows.append([told[name] for name in laws])
            weights.append(weight / len(robots))
    return np.array(rows).reshape(len(rows), len(laws)), np.array(weights, dtype=Long)


def is_exact(case: Case) -> bool:
    """Whether the fleet is a list of measured robots, so that its shares are counted."""
    varies = [name for name, law in case.laws.items() if ends_of(law)[0] < ends_of(law)[1]]
    cloud = _cloud(case)
    free = [name for name in varies if name not in cloud]
    return all(case.laws[name][0] == "samples" for name in free)


def drawn(case: Case, count: int) -> tuple[Floats, Longs]:
    """Members of equal weight, evenly scattered in the laws; measured robots themselves if they are all there is."""
    if is_exact(case):
        return rule(case)
    laws, cloud = case.laws, _cloud(case)
    primes = np.sqrt(np.array([1.0, 2.0, 3.0, 5.0, 7.0, 11.0])[: max(1, len(laws))])
    share = (0.5 + np.arange(count)[:, None] * primes) % 1.0
    share[:, 0] = (0.5 + np.arange(count)) / count
    rows = np.column_stack([quantiles(law, s) for law, s in zip(laws.values(), share.T, strict=False)])
    if cloud:
        first = list(laws).index(cloud[0])
        robots = (share[:, first] * len(laws[cloud[0]][1])).astype(int)
        for name in cloud:
            rows[:, list(laws).index(name)] = np.array(laws[name][1])[robots]
    return rows, np.full(count, Long(1) / count)


def _cloud(case: Case) -> tuple[str, ...]:
    """Names whose values belong together; none for ranges other than the fleet's."""
    return () if case.ranges else case.cloud


def _normal(law: Law) -> Any:
    """A normal law cut off at its ends."""
    _, low, high, mean, deviation = law
    return stats.truncnorm((low - mean) / deviation, (high - mean) / deviation, loc=mean, scale=deviation)
