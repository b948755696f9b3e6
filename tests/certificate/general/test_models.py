"""Polynomial models and intervals against ball arithmetic: what they claim holds at random points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import flint
import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import NotSmooth, Unenclosed
from ensemble_ctrl.certificate.general.basis import Basis, restriction, restriction_error
from ensemble_ctrl.certificate.general.gradients import Gradient
from ensemble_ctrl.certificate.general.models import Model
from ensemble_ctrl.systems import arrays

Floats = NDArray[np.float64]
Ball = Any
flint.ctx.prec = 200

BASES = [Basis(6, ()), Basis(6, (5,)), Basis(5, (4, 2)), Basis(4, (3, 3, 1)), Basis(3, (2, 2, 2, 2))]
FUNCTIONS: dict[str, tuple[Callable[..., Any], Callable[..., Ball]]] = {
    "sum": (lambda a, b: a + b - 0.3, lambda a, b: a + b - flint.arb(0.3)),
    "product": (lambda a, b: a * b, lambda a, b: a * b),
    "quotient": (lambda a, b: a / (b + 4.0), lambda a, b: a / (b + 4)),
    "from_number": (lambda a, b: 2.0 / (a + 5) - 3, lambda a, b: 2 / (a + 5) - 3),
    "sin": (lambda a, b: arrays.sin(3 * a), lambda a, b: (3 * a).sin()),
    "cos": (lambda a, b: arrays.cos(a - b), lambda a, b: (a - b).cos()),
    "tan": (lambda a, b: arrays.tan(a / 2), lambda a, b: (a / 2).tan()),
    "exp": (lambda a, b: arrays.exp(a), lambda a, b: a.exp()),
    "log": (lambda a, b: arrays.log(a + 6), lambda a, b: (a + 6).log()),
    "sqrt": (lambda a, b: arrays.sqrt(a + 4), lambda a, b: (a + 4).sqrt()),
    "tanh": (lambda a, b: arrays.tanh(a), lambda a, b: a.tanh()),
    "arctan": (lambda a, b: arrays.arctan(b / 2), lambda a, b: (b / 2).atan()),
    "powers": (lambda a, b: a**3 - b**2 + (a + 5) ** -2, lambda a, b: a**3 - b**2 + (a + 5) ** -2),
    "roots": (lambda a, b: (a + 5) ** 1.5 + 2.0**b, lambda a, b: (a + 5) * (a + 5).sqrt() + flint.arb(2) ** b),
    "numpy": (
        lambda a, b: np.sin(a) * np.float64(0.1) + np.exp(-b),
        lambda a, b: a.sin() * flint.arb(0.1) + (-b).exp(),
    ),
}


def polynomial(rng: np.random.Generator, basis: Basis, pieces: int) -> Model:
    """Random coefficients that fall with their degree, of a size below 2."""
    c = rng.normal(size=(pieces, *basis.shape)) * 0.4 ** np.add.outer(
        np.arange(basis.times), basis.exponents.sum(axis=1)
    )
    c *= rng.uniform(0.2, 1.9, (pieces, 1, 1)) / np.abs(c).sum(axis=(1, 2), keepdims=True)
    return Model(basis, c, np.abs(rng.normal(size=pieces)) * 10.0 ** rng.uniform(-16, -2, pieces))


def chebyshev(count: int, x: Ball) -> list[Ball]:
    """T_0 .. T_(count - 1) at a ball."""
    values = [flint.arb(1), x]
    for _ in range(count):
        values.append(2 * x * values[-1] - values[-2])
    return values[:count]


def at(model: Model, piece: int, tau: Ball, s: list[Ball]) -> Ball:
    """The polynomial of a model at a point, as a ball."""
    times = chebyshev(model.basis.times, tau)
    lines = [chebyshev(d + 1, x) for d, x in zip(model.basis.degrees, s, strict=True)]
    total = flint.arb(0)
    for i, row in enumerate(model.c[piece].tolist()):
        for c, exponents in zip(row, model.basis.exponents.tolist(), strict=True):
            term = flint.arb(c) * times[i]
            for line, power in zip(lines, exponents, strict=True):
                term *= line[power]
            total += term
    return total


def member(model: Model, piece: int, tau: Ball, s: list[Ball], share: float) -> Ball:
    """One of the functions that a model stands for: its polynomial, moved by a share of the remainder."""
    return at(model, piece, tau, s) + flint.arb(model.r[piece]) * flint.arb(share)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("basis", BASES, ids=str)
@pytest.mark.parametrize("flat", ["neither", "one", "both"])
def test_a_model_holds_every_function_it_stands_for(name: str, basis: Basis, flat: str) -> None:
    """At random points and for remainders used in full, the true value is within the remainder of the result.

    Also for operands that are constant in time, which are multiplied in another way.
    """
    rng = np.random.default_rng(len(name) + 10 * basis.parameters)
    a, b = polynomial(rng, basis, 6), polynomial(rng, basis, 6)
    for model in {"neither": (), "one": (b,), "both": (a, b)}[flat]:
        model.c[:, 1:] = 0.0
    ours, true = FUNCTIONS[name]
    result = ours(a, b)
    for piece in range(6):
        for _ in range(3):
            inside = rng.uniform(-1, 1, basis.parameters + 1)
            point = np.where(rng.random() < 0.4, np.sign(inside), inside).tolist()
            tau, *s = (flint.arb(x) for x in point)
            shares = [float(x) for x in rng.choice([-1.0, 0.0, 1.0], 2)]
            value = true(member(a, piece, tau, s, shares[0]), member(b, piece, tau, s, shares[1]))
            gap = abs(value - at(result, piece, tau, s))
            assert gap.upper() <= flint.arb(float(result.r[piece])), (name, piece)


@pytest.mark.parametrize("name", [n for n in FUNCTIONS if n not in ("arctan",)])
def test_a_remainder_is_no_larger_than_it_has_to_be(name: str) -> None:
    """Of exact operands whose degrees leave room, what is missed is near rounding, but for truncated terms."""
    rng = np.random.default_rng(3)
    basis = Basis(12, (10,))
    a, b = (Model(basis, m.c, np.zeros(4)) for m in (polynomial(rng, basis, 4), polynomial(rng, basis, 4)))
    for m in (a, b):
        m.c[:, 4:] = m.c[:, :, 4:] = 0.0
        m.c *= 0.3
    assert FUNCTIONS[name][0](a, b).r.max() < 1e-4


def test_the_error_of_a_product_is_needed() -> None:
    """Products miss more than nothing: without the term for rounding, some would be wrong."""
    rng = np.random.default_rng(0)
    basis, worst = Basis(6, (5,)), 0.0
    a, b = (Model(basis, polynomial(rng, basis, 40).c, np.zeros(40)) for _ in range(2))
    for m in (a, b):
        m.c[:, 3:] = m.c[:, :, 3:] = 0.0
    result = a * b
    for piece in range(40):
        tau, s = flint.arb(float(rng.uniform(-1, 1))), [flint.arb(float(rng.uniform(-1, 1)))]
        gap = abs(at(a, piece, tau, s) * at(b, piece, tau, s) - at(result, piece, tau, s))
        worst = max(worst, float(gap.upper()))
        assert float(gap.upper()) <= result.r[piece]
    assert worst > 1e-18


@pytest.mark.parametrize("count", [2, 5, 8, 10])
def test_a_restriction_is_right_to_its_error(count: int) -> None:
    """A polynomial moved to a part of its range differs by at most the stated error, also for parts without length."""
    rng = np.random.default_rng(count)
    for _ in range(20):
        low, high = sorted(rng.uniform(-1, 1, 2).tolist())
        high = low if rng.random() < 0.2 else high
        c, s = rng.normal(size=count), float(rng.uniform(-1, 1))
        moved = restriction(count, low, high) @ c
        place = (flint.arb(low) + flint.arb(high)) / 2 + (flint.arb(high) - flint.arb(low)) / 2 * flint.arb(s)
        true = sum((flint.arb(x) * t for x, t in zip(c, chebyshev(count, place), strict=True)), flint.arb(0))
        ours = sum((flint.arb(x) * t for x, t in zip(moved, chebyshev(count, flint.arb(s)), strict=True)), flint.arb(0))
        assert abs(true - ours).upper() <= flint.arb(restriction_error(count) * float(np.abs(c).sum()))


DERIVATIVES: dict[str, tuple[Callable[[Any], Any], Callable[[Ball], tuple[Ball, Ball]]]] = {
    "sin": (arrays.sin, lambda x: (x.sin(), x.cos())),
    "cos": (arrays.cos, lambda x: (x.cos(), -x.sin())),
    "tan": (lambda x: arrays.tan(x / 9), lambda x: ((x / 9).tan(), (1 + (x / 9).tan() ** 2) / 9)),
    "exp": (arrays.exp, lambda x: (x.exp(), x.exp())),
    "tanh": (arrays.tanh, lambda x: (x.tanh(), 1 - x.tanh() ** 2)),
    "arctan": (arrays.arctan, lambda x: (x.atan(), 1 / (1 + x * x))),
    "log": (lambda x: arrays.log(x + 20), lambda x: ((x + 20).log(), 1 / (x + 20))),
    "sqrt": (lambda x: arrays.sqrt(x + 20), lambda x: ((x + 20).sqrt(), 1 / (2 * (x + 20).sqrt()))),
    "reciprocal": (lambda x: 1 / (x - 30), lambda x: (1 / (x - 30), -1 / (x - 30) ** 2)),
    "square": (lambda x: x**2 - 0.1 * x, lambda x: (x * x - flint.arb(0.1) * x, 2 * x - flint.arb(0.1))),
    "cube": (lambda x: -(x**3), lambda x: (-(x**3), -3 * x**2)),
}


@pytest.mark.parametrize("name", DERIVATIVES)
def test_intervals_hold_values_and_derivatives(name: str) -> None:
    """For intervals narrow and wide, the ends' and random points' values and derivatives are inside."""
    rng = np.random.default_rng(len(name))
    low = rng.uniform(-12, 12, 300)
    high = low + 10.0 ** rng.uniform(-14, 0.8, 300)
    ours, true = DERIVATIVES[name]
    found = ours(Gradient.of(low, high, 1, 0))
    for k in range(300):
        for x in (low[k], high[k], min(low[k] + (high[k] - low[k]) * rng.random(), high[k])):
            value, slope = true(flint.arb(float(x)))
            for low_, high_, ball in (
                (found.low[k], found.high[k], value),
                (found.low_by[0, k], found.high_by[0, k], slope),
            ):
                assert flint.arb(low_) <= ball.upper()
                assert ball.lower() <= flint.arb(high_)


@pytest.mark.parametrize("kind", [Model, Gradient])
def test_what_is_not_smooth_is_refused(kind: type) -> None:
    """Comparisons, truth values, rounding, absolute values at zero, and division by what may vanish."""
    basis = Basis(3, (2,))
    c = np.zeros((1, *basis.shape))
    c[0, 1, 0] = 1.0
    x: Any = Model(basis, c, np.zeros(1)) if kind is Model else Gradient.of(-np.ones(1), np.ones(1), 1, 0)
    tried: list[Callable[[], Any]] = [
        lambda: x > 0,
        lambda: bool(x),
        lambda: float(x),
        lambda: abs(x),
        lambda: round(x),
    ]
    tried += [lambda: max(x, 0.0), lambda: np.maximum(x, 0.0), lambda: np.sign(x), lambda: x % 2.0]
    for attempt in tried:
        with pytest.raises(NotSmooth):
            attempt()
    for attempt in (lambda: 1.0 / x, lambda: x.sqrt(), lambda: x.log()):
        with pytest.raises(Unenclosed):
            attempt()
