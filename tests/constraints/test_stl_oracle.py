"""The exact robustness against rtamt, on 2,000 random formulas and signals.

Differences that the translation to rtamt covers: its until holds the left side on [t, t') and ours on
[t, t'], so the right side gets the left one added; past the end of a trace it pads with infinities where we
refuse, so formulas stay in the horizon; it doesn't divide a predicate by the norm of its coefficients, so the
predicates here have one state with coefficient 1 or -1.
"""

import numpy as np
import pytest
import rtamt

from ensemble_ctrl.constraints.stl import (
    Always,
    And,
    Eventually,
    ExactOps,
    Formula,
    Not,
    Or,
    Predicate,
    StateSignals,
    Until,
    member_robustness,
)
from tests.examples import quick

STEPS = 14


def random_formula(rng: np.random.Generator, depth: int, left: int) -> Formula:
    """A formula that looks at most `left` steps of one second ahead."""
    if depth == 0 or rng.random() < 0.15:
        sign = float(rng.choice([-1, 1]))
        return Predicate(((str(rng.choice(["x", "y"])), sign),), float(np.round(rng.normal(), 3)))
    b = int(rng.integers(0, left // 2 + 1))
    a = int(rng.integers(0, b + 1))

    def child(rest: int) -> Formula:
        return random_formula(rng, depth - 1, rest)

    match rng.integers(6):
        case 0:
            return Not(child(left))
        case 1:
            return And((child(left), child(left)))
        case 2:
            return Or((child(left), child(left)))
        case 3:
            return Eventually(child(left - b), a, b)
        case 4:
            return Always(child(left - b), a, b)
    return Until(child(left - b), child(left - b), a, b)


def in_rtamt(formula: Formula) -> str:
    """The formula in rtamt's language."""
    parts = [f"({in_rtamt(part)})" for part in formula.parts]
    match formula:
        case Predicate(coefficients=((name, sign),), offset=offset):
            return f"{name} >= {-offset!r}" if sign > 0 else f"{name} <= {offset!r}"
        case Not():
            return f"not {parts[0]}"
        case And():
            return " and ".join(parts)
        case Or():
            return " or ".join(parts)
        case Eventually():
            return f"eventually[{formula.a}:{formula.b}] {parts[0]}"
        case Always():
            return f"always[{formula.a}:{formula.b}] {parts[0]}"
        case Until():
            return f"{parts[0]} until[{formula.a}:{formula.b}] ({parts[1]} and {parts[0]})"
    raise AssertionError(formula)


def rtamt_value(formula: Formula, states: np.ndarray) -> float:
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in ("x", "y", "out"):
        spec.declare_var(name, "float")
    spec.spec = f"out = {in_rtamt(formula)}"
    spec.parse()
    trace = {"time": list(range(STEPS + 1)), "x": states[:, 0].tolist(), "y": states[:, 1].tolist()}
    return float(spec.evaluate(trace)[0][1])


@pytest.mark.parametrize("seed", quick(range(20240, 20245), 20240))
def test_exact_robustness_is_rtamts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(400):
        formula = random_formula(rng, depth=3, left=STEPS)
        states = rng.normal(scale=2, size=(STEPS + 1, 2))
        got = member_robustness(formula, StateSignals(states[None], ["x", "y"], 1.0), ExactOps())[0, 0]
        assert abs(got - rtamt_value(formula, states)) < 1e-9, str(formula)
