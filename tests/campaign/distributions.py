"""Distributions of parameters from SciPy: where their mass is, for means and for shares of the fleet."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from scipy import special, stats

from .model import Case, Distribution, Floats, Long, Longs, ends_of

MANY_NODES = {1: 24, 2: 14}
"""Points for each of so many parameters; else 8."""


def quantiles(distribution: Distribution, share: Floats) -> Floats:
    """The values below which these shares of the distribution lie."""
    match distribution[0]:
        case "uniform":
            return np.asarray(distribution[1] + share * (distribution[2] - distribution[1]))
        case "beta":
            return np.asarray(
                distribution[1]
                + (distribution[2] - distribution[1]) * stats.beta.ppf(share, distribution[3], distribution[4])
            )
        case "normal":
            return np.asarray(_normal(distribution).ppf(share))
        case "samples":
            values = np.sort(np.array(distribution[1]))
            return np.asarray(values[np.clip((share * len(values)).astype(int), 0, len(values) - 1)])
    total = sum(weight for _, weight in distribution[1])
    edges = np.cumsum([0.0, *(weight / total for _, weight in distribution[1])])
    part = np.clip(np.searchsorted(edges, share, side="right") - 1, 0, len(distribution[1]) - 1)
    inner = (share - edges[part]) / (edges[part + 1] - edges[part])
    return np.array([quantiles(distribution[1][k][0], np.array([s]))[0] for k, s in zip(part, inner, strict=True)])


def points(distribution: Distribution, count: int) -> tuple[Floats, Longs]:
    """Values and weights whose sum is the distribution's mean of any smooth function."""
    low, high = ends_of(distribution)
    match distribution[0]:
        case "uniform":
            x, w = special.roots_legendre(count)
        case "beta":
            x, w = special.roots_jacobi(count, distribution[4] - 1, distribution[3] - 1)
        case "normal":
            edges = np.linspace(low, high, 9)
            nodes, weights = special.roots_legendre(count)
            x = ((edges[:-1] + edges[1:])[:, None] + np.diff(edges)[:, None] * nodes).ravel() / 2
            w = np.tile(weights, 8) * _normal(distribution).pdf(x)
            return x, np.asarray(w.astype(Long) / w.astype(Long).sum())
        case "samples":
            return np.array(distribution[1]), np.full(len(distribution[1]), Long(1) / len(distribution[1]))
        case _:
            rules = [(points(part, count), weight) for part, weight in distribution[1]]
            total = Long(sum(Long(weight) for _, weight in distribution[1]))
            weights_ = [w * Long(weight) / total for (_, w), weight in rules]
            return np.concatenate([x for (x, _), _ in rules]), np.concatenate(weights_)
    w = w.astype(Long)
    return (low + high) / 2 + (high - low) / 2 * x, np.asarray(w / w.sum())


def rule(case: Case) -> tuple[Floats, Longs]:
    """Members and weights that stand for the fleet in a mean: measured robots themselves, nodes for the rest."""
    distributions, cloud = case.distributions, _cloud(case)
    others = [name for name in distributions if name not in cloud]
    each = MANY_NODES.get(len(others), 8)
    rules = [points(distributions[name], each) for name in others]
    robots = np.array([distributions[name][1] for name in cloud]).T if cloud else np.zeros((1, 0))
    rows, weights = [], []
    for choice in product(*(range(len(x)) for x, _ in rules)):
        values = dict(zip(others, (x[k] for (x, _), k in zip(rules, choice, strict=True)), strict=True))
        weight = np.prod([w[k] for (_, w), k in zip(rules, choice, strict=True)], dtype=Long)
        for robot in robots:
            told = {**values, **dict(zip(cloud, robot, strict=True))}
            rows.append([told[name] for name in distributions])
            weights.append(weight / len(robots))
    return np.array(rows).reshape(len(rows), len(distributions)), np.array(weights, dtype=Long)


def is_exact(case: Case) -> bool:
    """Whether the fleet is a list of measured robots, so that its shares are counted."""
    varies = [
        name for name, distribution in case.distributions.items() if ends_of(distribution)[0] < ends_of(distribution)[1]
    ]
    cloud = _cloud(case)
    free = [name for name in varies if name not in cloud]
    return all(case.distributions[name][0] == "samples" for name in free)


def drawn(case: Case, count: int) -> tuple[Floats, Longs]:
    """Members of equal weight, evenly scattered in the distributions; measured robots themselves if all are so."""
    if is_exact(case):
        return rule(case)
    distributions, cloud = case.distributions, _cloud(case)
    primes = np.sqrt(np.array([1.0, 2.0, 3.0, 5.0, 7.0, 11.0])[: max(1, len(distributions))])
    share = (0.5 + np.arange(count)[:, None] * primes) % 1.0
    share[:, 0] = (0.5 + np.arange(count)) / count
    rows = np.column_stack(
        [quantiles(distribution, s) for distribution, s in zip(distributions.values(), share.T, strict=False)]
    )
    if cloud:
        first = list(distributions).index(cloud[0])
        robots = (share[:, first] * len(distributions[cloud[0]][1])).astype(int)
        for name in cloud:
            rows[:, list(distributions).index(name)] = np.array(distributions[name][1])[robots]
    return rows, np.full(count, Long(1) / count)


def _cloud(case: Case) -> tuple[str, ...]:
    """Names whose values belong together; none for ranges other than the fleet's."""
    return () if case.ranges else case.cloud


def _normal(distribution: Distribution) -> Any:
    """A normal distribution cut off at its ends."""
    _, low, high, mean, deviation = distribution
    return stats.truncnorm((low - mean) / deviation, (high - mean) / deviation, loc=mean, scale=deviation)
