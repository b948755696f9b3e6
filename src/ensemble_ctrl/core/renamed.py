"""Names of an earlier version that still work for one release, with a warning that names the new one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

T = TypeVar("T")


def renamed_fields(**names: str) -> Callable[[type[T]], type[T]]:
    """A class decorator: arguments and attributes that have another name today, old name to new.

    Both work for one release, with a DeprecationWarning.

    Examples
    --------
    >>> @renamed_fields(old="new")
    ... class Pair:
    ...     def __init__(self, new=1):
    ...         self.new = new
    >>> Pair(old=2).new                                            # doctest: +SKIP
    2
    """

    def decorate(cls: type[T]) -> type[T]:
        known: Callable[..., None] = cls.__init__

        @wraps(known)
        def init(self: T, *args: Any, **given: Any) -> None:
            for old in given.keys() & names.keys():
                _warn(cls, old, names[old])
                if names[old] in given:
                    raise TypeError(f"{cls.__name__}: expected {names[old]} once, got it as {old} too")
                given[names[old]] = given.pop(old)
            known(self, *args, **given)

        cls.__init__ = init  # type: ignore[method-assign, assignment]
        for old, new in names.items():
            setattr(cls, old, property(_reader(cls, old, new)))
        return cls

    return decorate


def _reader(cls: type[Any], old: str, new: str) -> Callable[[Any], Any]:
    """Reads the new field, with a warning."""

    def read(self: Any) -> Any:
        _warn(cls, old, new)
        return getattr(self, new)

    return read


def _warn(cls: type[Any], old: str, new: str) -> None:
    """Name the new field to whoever used the old one."""
    warn_renamed(f"{cls.__name__}.{old}", new, depth=2)


def warn_renamed(old: str, new: str, depth: int = 1) -> None:
    """Warn that a name is deprecated.

    Parameters
    ----------
    old, new : str
        As the user writes them.
    depth : int
        How many functions lie between the user's line and the caller of this one, plus one.
    """
    message = f"{old} is deprecated and goes with the next release: use {new}"
    warnings.warn(message, DeprecationWarning, stacklevel=2 + depth)
