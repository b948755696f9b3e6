"""Validators shared by the moments room; each returns the checked value."""

from __future__ import annotations

import operator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.core.errors import ProblemError

MAX_ORDER = 50


def whole_number(name: str, value: object, least: int, most: int) -> int:
    """A whole number in [least, most], as an int."""
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = least - 1
    if isinstance(value, bool | np.bool_) or not least <= number <= most:
        raise ProblemError(f"{name}: expected a whole number from {least} to {most}, got {value!r}")
    return number


def finite_number(name: str, value: object) -> float:
    """A finite real number, as a float."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if isinstance(value, str | bytes | bool) or not np.isfinite(number):
        raise ProblemError(f"{name}: expected a finite number, got {value!r}")
    return number


def ends(lower: object, upper: object) -> tuple[float, float]:
    """The ends of a range, in order."""
    low, high = finite_number("lower", lower), finite_number("upper", upper)
    if low > high:
        raise ProblemError(f"upper: expected at least lower = {low:g}, got {high:g}")
    return low, high


def number_between(name: str, value: object, least: float, most: float) -> float:
    """A finite number in [least, most], as a float."""
    number = finite_number(name, value)
    if not least <= number <= most:
        raise ProblemError(f"{name}: expected a number from {least:g} to {most:g}, got {number:g}")
    return number


def finite_array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """A float array without NaN or infinity."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ProblemError(f"{name}: expected an array of numbers, got {value!r}") from error
    if not np.isfinite(array).all():
        raise ProblemError(f"{name}: expected finite numbers, got NaN or infinity")
    return array


def scaled_points(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """A float array whose entries lie in [-1, 1], up to rounding."""
    points = finite_array(name, value)
    if points.size and np.abs(points).max() > 1 + 1e-9:
        span = f"{points.min():g} to {points.max():g}"
        raise ProblemError(
            f"{name}: expected scaled parameters in [-1, 1], got {span}; Interval.to_scaled converts them"
        )
    return points


def along_order_axis(name: str, value: ArrayLike, length: int | None) -> NDArray[np.float64]:
    """A finite array of shape (length,) or (..., length, n); any length where it is None."""
    array = finite_array(name, value)
    axis = max(array.ndim - 2, 0)
    if array.ndim == 0 or (length is not None and array.shape[axis] != length):
        size = "k" if length is None else str(length)
        raise ProblemError(f"{name}: expected shape ({size},) or (..., {size}, n), got {array.shape}")
    return array


def frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same array, read-only, so that a cache can hand it out."""
    array.setflags(write=False)
    return array
