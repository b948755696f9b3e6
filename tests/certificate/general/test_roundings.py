"""Every term for rounding is needed: without it, what is claimed is wrong for some numbers, by exact arithmetic.

Each check counts how often a claim is wrong. It never is; with the term taken out it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, ClassVar

import flint
import numpy as np
import pytest
from numpy.typing import NDArray

from ensemble_ctrl.certificate.bound import Bound
from ensemble_ctrl.certificate.general import basis, boxes, clearance, enclosure, gradients, growth, models, task
from ensemble_ctrl.certificate.general.basis import Basis, Doubled, restriction_error
from ensemble_ctrl.certificate.general.boxes import Boxes
from ensemble_ctrl.certificate.general.clearance import Prover
from ensemble_ctrl.certificate.general.enclosure import Pieces
from ensemble_ctrl.certificate.general.gradients import Gradient
from ensemble_ctrl.certificate.general.models import Model
from ensemble_ctrl.certificate.general.start import Start
from ensemble_ctrl.constraints import Obstacle
from ensemble_ctrl.constraints.stl.leaves import Predicate
from ensemble_ctrl.systems import OdeSystem

Floats = NDArray[np.float64]
flint.ctx.prec = 300
COUNT = 200
PLANE = Basis(4, (3,))


def exact(values: Floats) -> list[Fraction]:
    """Sums of the last two axes: polynomials where every Chebyshev polynomial is 1."""
    return [sum(map(Fraction, row.ravel().tolist()), Fraction(0)) for row in values]


def drawn(rng: np.random.Generator, flat: bool = False, constant: bool = False, low: bool = False) -> Model:
    """Random polynomials between 1 and 3, without remainder; `low` ones have products without terms to drop."""
    c = 0.1 * rng.uniform(-1, 1, (COUNT, *PLANE.shape))
    if low:
        c[:, 2:] = c[:, :, 2:] = 0.0
    c[:, 1:] *= not flat and not constant
    c[:, :, 1:] *= not constant
    c[:, 0, 0] = rng.uniform(1.8, 2.2, COUNT)
    return Model(PLANE, c, np.zeros(COUNT))


def missed(result: Model, truth: Sequence[Any]) -> int:
    """How many results are further from the truth at the corner than their remainder."""
    pairs = zip(exact(result.c), result.r.tolist(), truth, strict=True)
    return sum(not abs(ball(value) - t) <= flint.arb(r) for value, r, t in pairs)


def ball(value: Fraction) -> Any:
    """A number as a ball."""
    return flint.arb(flint.fmpq(value.numerator, value.denominator))


def operation(ours: Callable[..., Model], true: Callable[..., Any], **kind: bool) -> Callable[[], int]:
    """A check of an operation on models."""

    def check() -> int:
        rng = np.random.default_rng(1)
        a, b = drawn(rng, **kind), drawn(rng, **kind)
        return missed(ours(a, b), [true(ball(x), ball(y)) for x, y in zip(exact(a.c), exact(b.c), strict=True)])

    return check


def intervals(ours: Callable[[Gradient, Gradient], Gradient], true: Callable[..., Fraction]) -> Callable[[], int]:
    """A check of an operation on intervals without width."""

    def check() -> int:
        rng = np.random.default_rng(2)
        x, y = rng.uniform(1, 3, (2, COUNT))
        found = ours(Gradient.of(x, x, 1, 0), Gradient.of(y, y, 1))
        truth = [true(Fraction(a), Fraction(b)) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
        pairs = zip(found.low.tolist(), truth, found.high.tolist(), strict=True)
        return sum(not Fraction(low) <= t <= Fraction(high) for low, t, high in pairs)

    return check


class Steady(OdeSystem):
    """Goes at the commanded speed."""

    name, states, positions = "steady", ("x",), ("x",)
    controls, control_units, input_bounds = ("u",), ("m/s",), ((-9.0, 9.0),)
    parameters: ClassVar[Mapping[str, float]] = {"p": 1.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        return [u[0]]


def pieces(duration: float = 0.7) -> Pieces:
    """Many steps of a steady robot, whose start and parameter have a width."""
    rng = np.random.default_rng(3)
    start = Start(("p", "start_x"), np.array([0.1, -0.3]), np.array([0.7, 0.4]), np.array([0.3]), np.array([-1, 0]))
    controls, wide = rng.uniform(1, 3, (COUNT, 1)), np.array([0, 1])
    return Pieces(Steady(), start, controls, duration, Basis(4, (1, 1)), wide, np.array([3, 7]), 1)


def defects() -> int:
    """The size of ``x~' - u`` in exact arithmetic."""
    some = pieces()
    centre, half = some._grid()
    c = some._polynomials(centre, half)
    c[:, :, :, 2:] = 0.0
    found = some.defect(c, centre, half)[:, 0, 0]
    h = Fraction(0.7) / COUNT
    truth = [abs(Fraction(c[k, 0, 0, 1, 0]) * 2 / h - Fraction(some.controls[k, 0])) for k in range(COUNT)]
    return sum(t > Fraction(f) for t, f in zip(truth, found.tolist(), strict=True))


def jumps() -> int:
    """The jump from the end of a piece to the beginning of the next, of polynomials with all their terms."""
    some = pieces()
    centre, half = some._grid()
    c = some._polynomials(centre, half)
    c[1:, 0, 0, 0, 0] -= c[1:, 0, 0, 1:, 0].sum(axis=1) * 0.5  # no longer what the iteration found
    found, wrong = some.jump(c, centre, half)[:, 0, 0], 0
    for k in range(1, COUNT):
        ends = [sum(map(Fraction, row)) for row in c[k - 1, 0, 0].T.tolist()]
        starts = [sum((-1) ** i * Fraction(x) for i, x in enumerate(row)) for row in c[k, 0, 0].T.tolist()]
        wrong += sum((abs(a - b) for a, b in zip(ends, starts, strict=True)), Fraction(0)) > Fraction(found[k])
    return wrong


def covers() -> int:
    """Cells cover the range."""
    rng, wrong = np.random.default_rng(11), 0
    for low, high in np.sort(rng.uniform(-1e-2, 1, (COUNT, 2)), axis=1).tolist():
        start = Start(("p",), np.array([low]), np.array([high]), np.array([0.3]), np.array([-1]))
        some = Pieces(Steady(), start, np.ones((1, 1)), 1.0, Basis(4, (1,)), np.array([0]), np.array([1]), 1)
        c, h = (Fraction(part[0, 0]) for part in some._grid())
        wrong += not (c - h <= Fraction(low) and c + h >= Fraction(high))
    return wrong


def exponentials() -> int:
    """Matrix exponentials within their error."""
    rng, wrong = np.random.default_rng(4), 0
    matrices = rng.uniform(-2, 2, (COUNT, 3, 3))
    found, error, _ = growth.exponential(matrices, 0.4)
    for k in range(COUNT):
        truth = (flint.arb_mat(matrices[k].tolist()) * flint.arb(0.4)).exp()
        gaps = [abs(truth[i, j] - flint.arb(found[k, i, j])) - flint.arb(error[k, i, j]) for i, j in np.ndindex(3, 3)]
        wrong += not all(gap <= 0 for gap in gaps)
    return wrong


def exponential_bounds() -> int:
    """Bounds of exponentials of matrices that are not negative."""
    rng, wrong = np.random.default_rng(5), 0
    matrices = rng.uniform(0, 1, (COUNT, 3, 3))
    found = growth.exponential_bound(matrices)
    for k in range(COUNT):
        truth = flint.arb_mat(matrices[k].tolist()).exp()
        wrong += any(truth[i, j].lower() > flint.arb(found[k, i, j]) for i in range(3) for j in range(3))
    return wrong


def frames() -> int:
    """Components in frames, of vectors almost along one side: some frames are orthogonal, others but for rounding."""
    rng, wrong = np.random.default_rng(6), 0
    signs = np.array([[1, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]]) / 2
    frame = np.concatenate([np.linalg.qr(rng.normal(size=(COUNT, 4, 4)))[0], np.tile(signs, (COUNT, 1, 1))])
    columns = frame[:, :, :1] * rng.uniform(1, 9, (2 * COUNT, 1, 1)) * rng.uniform(1, 1 + 1e-14, (2 * COUNT, 4, 1))
    found = growth._solved(frame, columns)
    for k in range(2 * COUNT):
        truth = flint.arb_mat(frame[k].tolist()).solve(flint.arb_mat(columns[k].tolist()))
        wrong += any(abs(truth[i, 0]).lower() > flint.arb(found[k, i, 0]) for i in range(4))
    return wrong


def box(c: Floats) -> Boxes:
    """Boxes with such coefficients, and no radius."""
    n = len(c)
    none = np.zeros(c.shape[:2])
    return Boxes(
        PLANE, np.array([0]), c, none, none, np.zeros(n, dtype=int), -np.ones(n), np.ones(n),
        np.zeros((n, 1)), np.ones((n, 1)),
    )  # fmt: skip


def parts(side: int) -> Callable[[], int]:
    """Boxes halved in time or in the parameter: their common corner keeps its place."""

    def check() -> int:
        c = np.random.default_rng(7).uniform(-1, 1, (COUNT, 1, *PLANE.shape))
        found = box(c).halved(np.full(COUNT, side)).where(np.arange(COUNT, 2 * COUNT))
        pairs = zip(exact(found.c), exact(c), found.pad[:, 0].tolist(), strict=True)
        return sum(abs(a - b) > Fraction(pad) for a, b, pad in pairs)

    return check


def combinations() -> int:
    """Quantities that are sums of several states."""
    rng = np.random.default_rng(8)
    c, row = rng.uniform(-1, 1, (COUNT, 3, 1, *PLANE.shape)), rng.uniform(-1, 1, (1, 3))
    no = np.zeros((COUNT, 3, 1))
    some = enclosure.Enclosure(PLANE, c, no, np.zeros((1, 1)), np.ones((1, 1)), 1, np.array([0]), no)
    found = Boxes.of(some, row, np.arange(COUNT), -np.ones(COUNT), np.ones(COUNT))
    truth = [sum(Fraction(row[0, s]) * exact(c[k])[s] for s in range(3)) for k in range(COUNT)]
    pairs = zip(exact(found.c), truth, found.pad[:, 0].tolist(), strict=True)
    return sum(abs(a - b) > Fraction(pad) for a, b, pad in pairs)


def times() -> int:
    """Parts of pieces hold the times that they are for."""
    wrong = 0
    for n in range(1, COUNT):
        share = Fraction(n, 3 * COUNT + 1)
        value = 2 * (n / (3 * COUNT + 1)) - 1
        low, high = boxes.outwards(np.array([value]), np.array([value]))
        wrong += not Fraction(low[0]) <= 2 * share - 1 <= Fraction(high[0])
    return wrong


def distances() -> int:
    """Distances of points from an edge whose normal is (-4, 3) / 5."""
    rng = np.random.default_rng(9)
    slope = Obstacle.polygon([[0.0, 0.0], [3e3, 4e3], [3e3, 0.0]])
    c = np.zeros((COUNT, 2, *PLANE.shape))
    c[:, 0, 0, 0] = rng.uniform(100, 300, COUNT)
    c[:, 1, 0, 0] = rng.uniform(500, 900, COUNT)
    ends = np.zeros((1, 1)), np.ones((1, 1))
    no = np.zeros((1, 2, 1))
    none = enclosure.Enclosure(PLANE, 0 * c[:1, :, None], no, *ends, 1, np.array([0]), no)
    prover = Prover(none, np.eye(2), ("p",), -np.ones(1), np.ones(1), 1.0, 1)
    low, _ = prover._bounds(box(c), slope, None, Bound("it", -np.inf, -np.inf, {}, 0.0))
    places = [tuple(map(Fraction, place)) for place in c[:, :, 0, 0].tolist()]
    return sum(Fraction(b) > (3 * y - 4 * x) / 5 for b, (x, y) in zip(low.tolist(), places, strict=True))


def predicates() -> int:
    """Bounds of a linear predicate."""
    rng = np.random.default_rng(10)
    c = rng.uniform(-1, 1, (COUNT, 1, 2, 1, 1))
    elements = task.Elements(np.zeros(1, dtype=int), np.array([-1.0]), np.array([-1.0]))
    both = np.concatenate([c, 0 * c], axis=3)
    signals = task.Signals(Basis(2, ()), both, np.zeros((COUNT, 1, 2)), ("a", "b"), elements)
    predicate = Predicate((("a", 0.3), ("b", -0.7)), 0.1)
    coefficients, offset = predicate.normalised()
    row = dict(coefficients)
    low = signals.leaf(predicate, 0, 0)[:, 0]
    truth = [sum(Fraction(row[n]) * Fraction(c[k, 0, i, 0, 0]) for i, n in enumerate("ab")) for k in range(COUNT)]
    return sum(Fraction(a) > t + Fraction(offset) for a, t in zip(low.tolist(), truth, strict=True))


def off(check: Callable[[], int], name: str, size: float) -> Callable[[], int]:
    """A check with a library whose function is wrong by so many roundings, as some machines' are."""

    def with_it() -> int:
        whole = getattr(np, name)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(np, name, lambda x: whole(x) * (1 + size * basis.UNIT))
            return check()

    return with_it


def rounded(value: Any) -> Fraction:
    """The middle of a ball of 300 bits."""
    mantissa, exponent = value.mid().man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def unscaled(self: Model, factor: Floats, error: float) -> Model:
    """`Model._scaled` without its error."""
    return self * factor


def same(x: Floats) -> Floats:
    """No rounding outwards."""
    return x


EXP = operation(lambda a, b: a.exp(), lambda x, y: x.exp(), constant=True)
SIN = operation(lambda a, b: a.sin(), lambda x, y: x.sin(), constant=True)
EXPS = intervals(lambda a, b: a.exp(), lambda x, y: rounded(ball(x).exp()))
SINS = intervals(lambda a, b: a.sin(), lambda x, y: rounded(ball(x).sin()))
TERMS: dict[str, tuple[Callable[[], int], Any, str, Any]] = {
    "sum": (operation(lambda a, b: a + b, lambda x, y: x + y), models, "UNIT", 0.0),
    "multiple": (operation(lambda a, b: a * 0.3, lambda x, y: x * flint.arb(0.3)), models, "UNIT", 0.0),
    "divided": (operation(lambda a, b: a / 0.3, lambda x, y: x / flint.arb(0.3)), models, "UNIT", 0.0),
    "exponential": (off(EXP, "exp", 8), Model, "_scaled", unscaled),
    "sine": (off(SIN, "sin", 4), Model, "_scaled", unscaled),
    "exponential of an interval": (off(EXPS, "exp", 8), gradients, "LIBRARY", 0.0),
    "sine of an interval": (off(SINS, "sin", 8), gradients, "LIBRARY", 0.0),
    "interval sum": (intervals(lambda a, b: a + b, lambda x, y: x + y), gradients, "down", same),
    "interval product": (intervals(lambda a, b: a * b, lambda x, y: x * y), gradients, "up", same),
    "interval quotient": (intervals(lambda a, b: a / b, lambda x, y: x / y), gradients, "down", same),
    "slopes": (defects, enclosure, "UNIT", 0.0),
    "jumps": (jumps, enclosure, "UNIT", 0.0),
    "cells": (covers, enclosure, "up", same),
    "matrix exponentials": (exponentials, growth, "UNIT", 0.0),
    "bounds of exponentials": (exponential_bounds, growth, "UP", 1.0),
    "frames": (frames, growth, "UNIT", 0.0),
    "halves of time": (parts(0), boxes, "restriction_error", lambda count: 0.0),
    "halves of cells": (parts(1), boxes, "restriction_error", lambda count: 0.0),
    "sums of states": (combinations, boxes, "UNIT", 0.0),
    "times": (times, boxes, "outwards", lambda begin, end: (begin, end)),
    "distances": (distances, clearance, "UNIT", 0.0),
}
"""What is checked, and the term that is taken out: where it is, its name, and what is there instead."""


@pytest.mark.parametrize("name", TERMS)
def test_a_term_for_rounding_is_enough_and_needed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    check, where, term, instead = TERMS[name]
    assert check() == 0
    monkeypatch.setattr(where, term, instead)
    assert check() > 0


def test_roundings_of_a_predicate_are_enough_and_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """There are two terms, each of which makes up for the other."""
    assert predicates() == 0
    monkeypatch.setattr(task, "UNIT", 0.0)
    assert predicates() == 0
    monkeypatch.setattr(task, "restriction_error", lambda count: 0.0)
    assert predicates() > 0


@pytest.mark.parametrize(("flat", "error"), [(False, "error"), (True, "flat_error")])
def test_the_error_of_a_product_is_enough_and_needed(flat: bool, error: str) -> None:
    """Of polynomials, and of such that are constant in time."""
    check = operation(lambda a, b: a * b, lambda x, y: x * y, flat=flat, low=True)
    assert check() == 0
    doubled = PLANE.doubled
    assert isinstance(doubled, Doubled)
    whole = getattr(doubled, error)
    try:
        setattr(doubled, error, 0.0)
        assert check() > 0
    finally:
        setattr(doubled, error, whole)


def test_constants_are_those_of_the_page() -> None:
    """What ``docs/proof_systems.md`` derives."""
    assert basis.UNIT == 2.0**-53
    assert basis.UP == 1 + 1e-12
    assert gradients.LIBRARY == 16 * basis.UNIT
    assert 10 * basis.UNIT * 800_000 <= 1 / boxes.GRID
    n = 10
    assert restriction_error(n) >= (16 * n**2 * (1 + np.log(n)) + 2 * n * (2 * n + 12) + 8) * basis.UNIT
    assert Basis(10, (7,)).doubled.error >= (2 * (10 + 10) + 4 + 2 * 19 * 31) * basis.UNIT
