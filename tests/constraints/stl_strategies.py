"""Random formulas and signals, and the plainest robustness there is, to compare with."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Avoid,
    Eventually,
    Formula,
    Inside,
    Mean,
    Not,
    Or,
    Predicate,
    Release,
    Share,
    StateSignals,
    Until,
)

NAMES = ("x", "y")
numbers = st.floats(-100, 100).map(lambda v: round(v, 3)) | st.sampled_from([0.0, 1.0, -1.0, 1e-7, 1 / 3])


def predicates() -> st.SearchStrategy[Formula]:
    nonzero = numbers.filter(bool)
    terms = st.dictionaries(st.sampled_from(NAMES), nonzero, min_size=1)
    return st.builds(lambda c, d: Predicate(tuple(c.items()), d), terms, numbers)


def windows(times: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float | None, float | None]]:
    both = st.tuples(times, times).map(lambda ab: (min(ab), max(ab)))
    return both | st.just((None, None))


def formulas(leaf: st.SearchStrategy[Formula], times: st.SearchStrategy[float]) -> st.SearchStrategy[Formula]:
    """Every operator over some leaves."""

    def grow(child: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
        window = windows(times)
        some = st.lists(child, min_size=2, max_size=3).map(tuple)
        return st.one_of(
            st.builds(Not, child),
            st.builds(And, some),
            st.builds(Or, some),
            st.builds(lambda f, w: Eventually(f, *w), child, window),
            st.builds(lambda f, w: Always(f, *w), child, window),
            st.builds(lambda f, g, w: Until(f, g, *w), child, child, window),
            st.builds(Mean, child),
            st.builds(Share, st.sampled_from([0.1, 0.5, 0.95, 1.0]), child),
        )

    return st.recursive(leaf, grow, max_leaves=8)


def texts() -> st.SearchStrategy[Formula]:
    """Formulas for text: named places and T too."""
    places = st.sampled_from(["goal", "o1", "a-b.c", "F", "until", "obstacles"])
    leaf = predicates() | places.map(Inside) | places.map(Avoid)
    return formulas(leaf, st.sampled_from([0.0, 0.5, 2.0, 16.0, 1e-9, math.inf]))


def signals(seed: int, members: int = 3, steps: int = 20, step: float = 0.5) -> StateSignals:
    states = np.random.default_rng(seed).normal(scale=3, size=(members, steps + 1, 2))
    return StateSignals(states, NAMES, step)


@cache
def naive(formula: Formula, data: StateSignals, k: int) -> NDArray[np.float64]:
    """Robustness of each member at step k by the definition; shape (members,)."""
    match formula:
        case Predicate(coefficients=terms, offset=d):
            total = sum((c * data.states[:, k, NAMES.index(n)] for n, c in terms), np.full(data.members, d))
            return np.asarray(total / math.sqrt(sum(c * c for _, c in terms)))
        case Not(child=f):
            return -naive(f, data, k)
        case And(children=parts):
            return np.asarray(np.min([naive(f, data, k) for f in parts], axis=0))
        case Or(children=parts):
            return np.asarray(np.max([naive(f, data, k) for f in parts], axis=0))
        case Mean(child=f):
            return np.repeat(naive(f, data.mean(), k), data.members)
        case Share(p=p, child=f):
            value = np.sort(naive(f, data, k))[::-1]
            return np.full(data.members, value[max(math.ceil(p * data.members - 1e-9), 1) - 1])
        case Eventually(child=f):
            return np.asarray(np.max([naive(f, data, t) for t in window(formula, data, k)], axis=0))
        case Always(child=f):
            return np.asarray(np.min([naive(f, data, t) for t in window(formula, data, k)], axis=0))
        case Until(left=f, right=g):
            cases = [
                np.min([naive(g, data, t), *(naive(f, data, u) for u in range(k, t + 1))], axis=0)
                for t in window(formula, data, k)
            ]
            return np.asarray(np.max(cases, axis=0))
    raise AssertionError(formula)


def window(formula: Eventually | Always | Until | Release, data: StateSignals, k: int) -> range:
    if formula.a is None or formula.b is None:
        last = data.steps - max(look_ahead(f, data.step) for f in formula.parts)
        return range(k, last + 1)
    low, high = math.ceil(formula.a / data.step - 1e-9), math.floor(formula.b / data.step + 1e-9)
    return range(k + low, k + high + 1)


def look_ahead(formula: Formula, step: float) -> int:
    own = getattr(formula, "b", None) or 0.0
    return math.floor(own / step + 1e-9) + max((look_ahead(f, step) for f in formula.parts), default=0)
