"""Single values that callers give: read as the package keeps them, or refused by "expected .., got .."."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Mapping
from dataclasses import fields
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.errors import ProblemError, shortened

Floats = NDArray[np.float64]
T = TypeVar("T")


def shown(value: object) -> str:
    """A value that came, with its type, shortened."""
    if value is None:
        return "None"
    return f"{shortened(' '.join(repr(value).split()))} ({type(value).__name__})"


def known_only(what: str, made: Any, changes: dict[str, Any], *more: str) -> dict[str, Any]:
    """Changes of the fields of a dataclass, or of `more` that it is made from.

    Raises
    ------
    ProblemError
        For a name that is none of them.
    """
    known = [*(field.name for field in fields(made) if field.init), *more]
    for name in changes:
        if name not in known:
            raise ProblemError(f"{what}: expected names among {', '.join(known)}, got {name!r}")
    return changes


def expect(name: str, value: object, kind: type[T], wanted: str = "") -> T:
    """A value of a type; `wanted` says what that is, if not its name."""
    if not isinstance(value, kind):
        what = kind.__name__
        article = "an" if what[0] in "AEIOU" else "a"
        raise ProblemError(f"{name}: expected {wanted or f'{article} {what}'}, got {shown(value)}")
    return value


def exact(value: float) -> Fraction:
    """The decimal number that was written.

    Examples
    --------
    >>> exact(0.07) * 100, 0.07 * 100
    (Fraction(7, 1), 7.000000000000001)
    """
    return Fraction(repr(float(value)))


def rest_of(share: float) -> float:
    """One less a share, as it would be written: 0.07 of 0.93."""
    return float(1 - exact(share))


def flag(name: str, value: object) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ProblemError(f"{name}: expected True or False, got {shown(value)}")
    return bool(value)


def numbers(name: str, value: Any, wanted: str = "numbers") -> Floats:
    """A copy as an array of floats, of any shape, finite or not."""
    try:
        if value is None or isinstance(value, str | bytes | Mapping):
            raise TypeError(value)
        if np.iscomplexobj(value) or (hasattr(value, "_mask") and np.ma.is_masked(value)):  # a part of it would be lost
            raise TypeError(value)
        return np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ProblemError(f"{name}: expected {wanted}, got {shown(value)}") from None


def number(name: str, value: Any) -> float:
    """One number, finite or not."""
    array = numbers(name, value, "a number")
    if array.ndim or isinstance(value, bool):
        raise ProblemError(f"{name}: expected a number, got {shown(value)}")
    return float(array)


def whole(name: str, value: Any, least: int) -> int:
    """A whole number of at least `least`."""
    try:
        found = operator.index(value)
    except TypeError:
        found = least - 1
    if isinstance(value, bool) or found < least:
        raise ProblemError(f"{name}: expected {least} or more, got {value if isinstance(value, int) else shown(value)}")
    return found


def path_of(name: str, value: Any, wanted: str = "a path") -> Path:
    """A path; `wanted` says what else would do."""
    if not isinstance(value, str | os.PathLike) or isinstance(os.fspath(value), bytes):
        raise ProblemError(f"{name}: expected {wanted}, got {shown(value)}")
    return Path(value)


def called(name: str, value: Any) -> Callable[..., Any]:
    """Something that can be called."""
    if not callable(value):
        raise ProblemError(f"{name}: expected a function, got {shown(value)}")
    return value  # type: ignore[no-any-return]
