"""The array operations a system needs, so that it is written once for NumPy and for CasADi."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class Arrays(Protocol):
    """What a system needs of an array library; `numpy` itself is one."""

    def sin(self, x: Any, /) -> Any:
        """Sine of an angle in radians."""

    def cos(self, x: Any, /) -> Any:
        """Cosine of an angle in radians."""

    def tan(self, x: Any, /) -> Any:
        """Tangent of an angle in radians."""

    def where(self, condition: Any, yes: Any, no: Any, /) -> Any:
        """`yes` where `condition` holds, else `no`."""


def sinc(x: Any, arrays: Arrays = np) -> Any:
    r"""``sin(x) / x`` with its limit 1 at zero, accurate to rounding everywhere.

    Parameters
    ----------
    x : array
        Angle in radians, any shape.
    arrays : Arrays
        The array library of `x`.

    Returns
    -------
    array
        Same shape, dimensionless.

    Notes
    -----
    Below 0.5 rad a Taylor polynomial stands in, so that derivatives taken by automatic differentiation are right at
    zero too; the unused branch never divides by zero.

    Examples
    --------
    >>> float(sinc(0.0)), round(float(sinc(np.pi / 2)), 6)
    (1.0, 0.63662)
    """
    small = abs(x) < 0.5
    square = x * x
    # Taylor polynomial up to x^12 in Horner form; at 0.5 its remainder x^14 / 15! is below rounding
    series = 1 - square / 110 * (1 - square / 156)
    for divisor in (72, 42, 20, 6):
        series = 1 - square / divisor * series
    if arrays is np and np.all(small):
        return series
    safe = arrays.where(small, 1.0, x)
    return arrays.where(small, series, arrays.sin(safe) / safe)


def _elementwise(name: str, plain: Any) -> Any:
    """A function of one argument for numbers, NumPy arrays and CasADi expressions alike."""

    def apply(x: Any) -> Any:
        own = getattr(x, name, None)
        return plain(x) if own is None else own()

    apply.__name__ = apply.__qualname__ = name
    apply.__doc__ = f"``{name}`` of every entry of a number, a NumPy array or a CasADi expression."
    return apply


sin = _elementwise("sin", np.sin)
cos = _elementwise("cos", np.cos)
tan = _elementwise("tan", np.tan)
sqrt = _elementwise("sqrt", np.sqrt)
exp = _elementwise("exp", np.exp)
log = _elementwise("log", np.log)
tanh = _elementwise("tanh", np.tanh)
arctan = _elementwise("arctan", np.arctan)


def arc(heading: Any, turn: Any) -> tuple[Any, Any]:
    """Means of the cosine and the sine of a heading that grows by `turn` at a constant rate, for all kinds of arrays.

    Parameters
    ----------
    heading, turn : array
        Radians: where it begins, and by how much it grows; any sign.

    Examples
    --------
    >>> [round(float(mean), 6) for mean in arc(0.0, np.pi)]
    [0.0, 0.63662]
    """
    half = turn / 2
    # sin(half) / half without a branch, so that expressions take it too; see `sinc`
    small = abs(half) < 0.5
    square = half * half
    series = 1 - square / 110 * (1 - square / 156)
    for divisor in (72, 42, 20, 6):
        series = 1 - square / divisor * series
    safe = half + small * (1 - half)
    chord = small * series + (1 - small) * sin(safe) / safe
    return chord * cos(heading + half), chord * sin(heading + half)
