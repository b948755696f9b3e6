"""Chebyshev models: numbers that are polynomials in time and parameters, with a bound of what the polynomial misses.

A `Model` stands for every function `f` with ``|f - sum c T| <= r`` on the whole piece; arithmetic on models holds for
all functions that the operands stand for, roundings included. Many pieces are treated at once: coefficients have the
shape (pieces, times, terms), remainders the shape (pieces,).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import NotSmooth
from ensemble_ctrl.certificate.general.basis import UNIT, UP, Basis
from ensemble_ctrl.certificate.general.smooth import Smooth

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PAIRS = 4_000_000
"""Products of coefficients held at a time."""
SERIES = 60
"""Most terms of a Taylor polynomial."""
ENOUGH = 1e-17
"""Remainder of a Taylor polynomial, relative to its largest term, below which no more terms are taken."""


@dataclass(eq=False)
class Model(Smooth):
    """A polynomial on each of many pieces, and a bound of what it misses.

    Attributes
    ----------
    basis : Basis
    c : ndarray, shape (pieces, times, terms)
        Coefficients.
    r : ndarray, shape (pieces,)
        Remainder, at least 0.
    """

    basis: Basis
    c: Floats
    r: Floats

    @classmethod
    def of(cls, basis: Basis, values: Floats) -> Model:
        """Numbers that do not change within a piece, shape (pieces,)."""
        c = np.zeros((len(values), *basis.shape))
        c[:, 0, 0] = values
        return cls(basis, c, np.zeros(len(values)))

    def _constant(self, value: float) -> Model:
        """A number."""
        return Model.of(self.basis, np.full(len(self.c), value))

    def size(self) -> Floats:
        """Upper bound of ``|f|`` on each piece, shape (pieces,)."""
        return np.asarray((np.abs(self.c).sum(axis=(1, 2)) + self.r) * UP)

    def deviation(self) -> Floats:
        """Upper bound of ``|f - c[0, 0]|`` on each piece."""
        rest = np.abs(self.c)
        rest[:, 0, 0] = 0.0
        return np.asarray((rest.sum(axis=(1, 2)) + self.r) * UP)

    @property
    def middle(self) -> Floats:
        """The constant term."""
        return np.asarray(self.c[:, 0, 0])

    @property
    def is_flat(self) -> bool:
        """Whether all polynomials are constant in time."""
        return not self.c[:, 1:].any()

    def range(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds of `f` on each piece."""
        middle, away = self.middle, self.deviation()
        return np.nextafter(middle - away, -np.inf), np.nextafter(middle + away, np.inf)

    def _rounded(self, c: Floats, r: Floats, roundings: float = 1.0) -> Model:
        """A result whose coefficients are each right to so many roundings of their size."""
        return Model(self.basis, c, (r + roundings * UNIT * np.abs(c).sum(axis=(1, 2))) * UP)

    def grown(self, amount: Floats) -> Model:
        """The same with a larger remainder."""
        return Model(self.basis, self.c, (self.r + amount) * UP)

    def __neg__(self) -> Model:
        return Model(self.basis, -self.c, self.r)

    def __abs__(self) -> Model:
        low, high = self.range()
        self._require((low > 0) | (high < 0), "the right-hand side takes |.| of what may vanish", NotSmooth)
        # |f| = f or -f: the sign is the same on the whole piece
        sign = np.where(low > 0, 1.0, -1.0)
        return Model(self.basis, self.c * sign[:, None, None], self.r)

    def __add__(self, other: Any) -> Model:
        if not isinstance(other, Model):
            other = Model.of(self.basis, _numbers(other, len(self.c)))
        return self._rounded(self.c + other.c, self.r + other.r)

    def __mul__(self, other: Any) -> Model:
        if not isinstance(other, Model):
            number = _numbers(other, len(self.c))
            return self._rounded(self.c * number[:, None, None], self.r * np.abs(number))
        # a factor that is one number: coefficient by coefficient
        for one, two in ((self, other), (other, self)):
            if not one.c[:, 1:].any() and not one.c[:, 0, 1:].any() and not one.r.any():
                return two * one.middle
        return self._times(other)

    def _times(self, other: Model) -> Model:
        """The product of two polynomials: exact degrees, then what is beyond the basis goes to the remainder."""
        doubled, (times, terms) = self.basis.doubled, self.basis.shape
        # A = sum |c^a|, B = sum |c^b|; only pairs of terms that occur are multiplied
        here, there = (np.abs(m.c).sum(axis=(1, 2)) for m in (self, other))
        mine, theirs = (np.flatnonzero(m.c.any(axis=(0, 1))) for m in (self, other))
        if not (len(mine) and len(theirs)):
            return Model(
                self.basis, np.zeros_like(self.c), self.r * (there * UP + other.r) * UP + other.r * here * UP**2
            )
        pairs = (mine[:, None] * terms + theirs).ravel()
        table = doubled.table[:, pairs]
        flat = self.is_flat or other.is_flat
        doubled.spent += len(self.c) * doubled.count * len(pairs)
        c, tail = np.zeros((len(self.c), times, terms)), np.zeros(len(self.c))
        block = max(1, PAIRS // (doubled.count * max(1, len(pairs))))
        for rows in (slice(i, i + block) for i in range(0, len(c), block)):
            a, b = self.c[rows][:, :, mine], other.c[rows][:, :, theirs]
            if flat:  # coefficients in time are multiples of those of the other
                a, b = (m[:, :1] if model.is_flat else m for m, model in ((a, self), (b, other)))
            else:  # values at the nodes in time
                a, b = doubled.to_times @ a, doubled.to_times @ b
            # all pairs of terms, summed by T_a T_b = (T_(a+b) + T_|a-b|) / 2
            outer = (a[..., :, None] * b[..., None, :]).reshape(-1, len(pairs))
            whole = (table @ outer.T).T.reshape(len(a), -1, doubled.terms)
            if not flat:
                whole = doubled.from_times @ whole
            # what is beyond the basis in time or in the parameters: its sum |c| goes to the remainder
            kept = whole[:, :times, :terms]
            c[rows, : kept.shape[1]] = kept
            tail[rows] = np.abs(whole[:, times:]).sum(axis=(1, 2)) + np.abs(whole[:, :times, terms:]).sum(axis=(1, 2))
        # r = dropped + r_a (B + r_b) + r_b A + eps A B (proof_systems.md, section 1)
        here, there = here * UP, there * UP
        error = doubled.flat_error if flat else doubled.error
        remainder = tail + self.r * (there + other.r) + other.r * here + error * here * there
        return Model(self.basis, c, remainder * UP)

    def __truediv__(self, other: Any) -> Model:
        if isinstance(other, Model):
            return self * other.reciprocal()
        number = _numbers(other, len(self.c))
        self._require(np.asarray(number != 0), "the right-hand side divides by zero")
        return self._rounded(self.c / number[:, None, None], self.r / np.abs(number), 2.0)

    def _applied(self, function: Callable[[Floats], Floats], name: str) -> Model:
        """A polynomial near a function of this one; nothing is claimed of how near."""
        # interpolation of the function at the nodes in time and in the parameters
        found = np.zeros_like(self.c)
        with np.errstate(all="ignore"):
            if self.is_flat:
                found[:, :1] = function(self.c[:, :1] @ self.basis.to_points.T) @ self.basis.from_points.T
            else:
                values = self.basis.to_times @ self.c @ self.basis.to_points.T
                found = self.basis.from_times @ function(values) @ self.basis.from_points.T
        good = np.asarray(np.isfinite(found).all(axis=(1, 2)))
        self._require(good, f"the right-hand side takes a function ({name}) where it may not be defined")
        return Model(self.basis, found, np.zeros(len(self.c)))

    def reciprocal(self) -> Model:
        """``1 / f``: with ``e = 1 - f y`` for a polynomial `y` near it, ``|1/f - y| <= |y| |e| / (1 - |e|)``."""
        if not self.c[:, 1:].any() and not self.c[:, 0, 1:].any() and not self.r.any():
            return Model.of(self.basis, np.ones(len(self.c))) / self.middle
        y = self._applied(np.reciprocal, "1/x")
        miss = (1.0 - self * y).size()
        self._require(np.asarray(miss < 0.5), "the right-hand side divides by something that may vanish")
        return y.grown(y.size() * miss / (1 - miss) * UP)

    def sqrt(self) -> Model:
        """Square root: ``|sqrt(f) - y| = |f - y^2| / (sqrt(f) + y) <= |f - y^2| / y`` for a positive `y` near it."""
        y = self._applied(np.sqrt, "sqrt")
        least = y.range()[0]
        good = (least > 0) & (self.range()[0] >= 0)
        self._require(good, "the right-hand side takes a square root of something that may not be positive")
        return y.grown((self - y * y).size() / least * UP)

    def log(self) -> Model:
        """Logarithm: with ``e = f exp(-y) - 1`` for a polynomial `y` near it, ``|log f - y| <= |e| / (1 - |e|)``."""
        self._require(
            self.range()[0] > 0, "the right-hand side takes a logarithm of something that may not be positive"
        )
        y = self._applied(np.log, "log")
        miss = (self * (-y).exp() - 1.0).size()
        self._require(miss < 0.5, "the right-hand side takes a logarithm over too wide a range")
        return y.grown(miss / (1 - miss) * UP)

    def arctan(self) -> Model:
        """Arc tangent: ``|arctan f - y| <= |f cos y - sin y| / (cos y + f sin y)`` for a polynomial `y` near it.

        The quotient is the tangent of the difference, which is continuous and near zero at one point, the middle, so
        that it stays on the branch of zero as long as the denominator is positive.
        """
        y = self._applied(np.arctan, "arctan")
        sine, cosine = y.sin(), y.cos()
        least = (cosine + self * sine).range()[0]
        here, there = (np.einsum("btp,t,p->b", m.c, self.basis.middle_time, self.basis.middle_cell) for m in (self, y))
        near = np.abs(np.arctan(here) - there) + self.r < 1.0
        self._require((least > 0) & near, "the right-hand side takes an arc tangent over too wide a range")
        return y.grown((self * cosine - sine).size() / least * UP)

    def tanh(self) -> Model:
        """Hyperbolic tangent: with ``E = exp(2 f)``, ``|tanh f - y| = |E (1 - y) - (1 + y)| / (E + 1)``."""
        y, power = self._applied(np.tanh, "tanh"), (self * 2.0).exp()
        # E + 1 >= 1, since E = exp(2 f) is positive
        least = np.maximum(power.range()[0], 0.0) + 1.0
        return y.grown((power * (1.0 - y) - (1.0 + y)).size() / least * UP)

    def exp(self) -> Model:
        """Exponential: that of the middle times a Taylor polynomial of the rest."""
        middle, rest, away = self._split()
        terms = _terms(away, 1)
        # Horner: exp d = 1 + d (1 + d/2 (1 + d/3 (...)))
        series = self._constant(1.0)
        for j in range(terms, 0, -1):
            series = 1.0 + rest * series / j
        with np.errstate(over="ignore"):
            # Lagrange: |d|^(n+1) / (n+1)! exp |d|
            tail = away ** (terms + 1) / float(factorial(terms + 1)) * np.exp(away) * (1 + 64 * UNIT) * UP
            factor = np.exp(middle)
        return series.grown(tail)._scaled(factor, 16 * UNIT)

    def sin(self) -> Model:
        """Sine."""
        return self._turned()[0]

    def cos(self) -> Model:
        """Cosine."""
        return self._turned()[1]

    def _turned(self) -> tuple[Model, Model]:
        """Sine and cosine: those of the middle, turned by Taylor polynomials of the rest."""
        middle, rest, away = self._split()
        terms = _terms(away, 2)
        square = rest * rest
        sine = cosine = self._constant(1.0)
        for j in range(terms - terms % 2 + 1, 1, -2):  # sin d = d (1 - d^2/6 (1 - d^2/20 (...)))
            sine = 1.0 - square * sine / (j * (j - 1))
        for j in range(terms - terms % 2 + 2, 1, -2):
            cosine = 1.0 - square * cosine / (j * (j - 1))
        # Lagrange: |d|^(n+2) / (n+2)! for the sine of degree n, one degree more for the cosine
        last = terms - terms % 2 + 1
        sine = (sine * rest).grown(away ** (last + 2) / float(factorial(last + 2)) * UP)
        cosine = cosine.grown(away ** (last + 3) / float(factorial(last + 3)) * UP)
        # sin(m + d) = sin m cos d + cos m sin d, cos(m + d) = cos m cos d - sin m sin d
        s, c = np.sin(middle), np.cos(middle)
        error = 8 * UNIT
        return (
            cosine._scaled(s, error) + sine._scaled(c, error),
            cosine._scaled(c, error) - sine._scaled(s, error),
        )

    def _split(self) -> tuple[Floats, Model, Floats]:
        """The middle, the rest as a model, and a bound of the rest's size; refused where the rest is large."""
        rest = Model(self.basis, self.c.copy(), self.r)
        rest.c[:, 0, 0] = 0.0
        away = self.deviation()
        self._require(away < 8.0, "an angle or exponent of the right-hand side varies by more than 8 within a piece")
        return self.middle, rest, away

    def _scaled(self, factor: Floats, error: float) -> Model:
        """Times a number for each piece, itself right to `error` times the larger of 1 and its size."""
        scaled = self * factor
        return scaled.grown(error * np.maximum(1.0, np.abs(factor)) * self.size())


def _numbers(value: Any, pieces: int) -> Floats:
    """A number, or one for each piece, as an array of shape (pieces,)."""
    return np.asarray(np.broadcast_to(np.asarray(value, dtype=float), (pieces,)))


def _terms(away: Floats, ahead: int) -> int:
    """How many terms of a Taylor polynomial leave a remainder below rounding for arguments up to the largest."""
    largest = float(away.max(initial=0.0))
    size, n = 1.0, 0
    while n < SERIES:
        n += 1
        size *= largest / n
        if size * largest**ahead <= ENOUGH * max(1.0, largest) and n > largest:
            break
    return n
