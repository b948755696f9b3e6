"""Dataclasses whose methods are made when a class is first used.

The standard decorator writes and compiles four to six functions for every class, which takes 0.3 to 0.5 ms. A run of
the command imports 260 dataclasses and uses a fifth of them. What a proof rests on uses the standard decorator.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from dataclasses import MISSING, Field, FrozenInstanceError
from dataclasses import dataclass as standard
from typing import TYPE_CHECKING, Any, TypeVar

T = TypeVar("T")

_MADE = ("__init__", "__repr__", "__match_args__", *(("__replace__",) if sys.version_info >= (3, 13) else ()))
"""What the standard decorator makes where the class does not define it."""
_LOCK = threading.RLock()
"""Held while a class is completed: two threads may use it first."""


class _Deferred:
    """Stands in a class for what the standard decorator makes; completes the class when it is looked up."""

    def __init__(self, cls: type[Any], name: str, complete: Callable[[], None]) -> None:
        self.cls, self.name, self.complete = cls, name, complete

    def __get__(self, instance: object, owner: type[Any] | None = None) -> Any:
        self.complete()
        made = vars(self.cls)[self.name]
        bind = getattr(type(made), "__get__", None)
        return made if bind is None else bind(made, instance, owner)


def deferred_dataclass(*, frozen: bool = False, eq: bool = True) -> Callable[[type[T]], type[T]]:
    """As `dataclasses.dataclass`, whose methods are made at the first instance or the first look at the fields.

    Parameters
    ----------
    frozen, eq : bool
        As there. For other options, use the standard decorator.

    Returns
    -------
    callable
        The decorator.

    Notes
    -----
    The standard decorator completes a copy of the class, from which each finished method is taken over: a class has all
    of its methods at any time, also while another thread completes it. A mistake in the order of fields is raised
    when the class is first used.

    Examples
    --------
    >>> @deferred_dataclass(frozen=True)
    ... class Point:
    ...     x: float
    ...     y: float = 0.0
    >>> Point(1.0)
    Point(x=1.0, y=0.0)
    """

    def decorate(cls: type[T]) -> type[T]:
        written = dict(vars(cls))

        def complete() -> None:
            with _LOCK:
                if written:
                    _complete(cls, written, frozen, eq)
                    written.clear()

        for name in _made(written, frozen, eq):
            setattr(cls, name, _Deferred(cls, name, complete))
        for name, value in written.items():
            if isinstance(value, Field):
                _leave_default(cls, name, value)
        if frozen:
            _freeze(cls)
        elif eq and "__hash__" not in written:
            cls.__hash__ = None  # type: ignore[assignment]
        return cls

    return decorate


def _made(written: dict[str, Any], frozen: bool, eq: bool) -> list[str]:
    """Names of all that the standard decorator makes, besides what forbids changes."""
    wanted = [*_MADE, "__eq__"] if eq else _MADE
    hashed = ["__hash__"] if eq and frozen and written.get("__hash__") is None else []
    return ["__dataclass_fields__", "__dataclass_params__", *(name for name in wanted if name not in written), *hashed]


def _complete(cls: type[Any], written: dict[str, Any], frozen: bool, eq: bool) -> None:
    """Take over what the standard decorator makes of a copy of the class."""
    own = {name: value for name, value in written.items() if name not in ("__dict__", "__weakref__")}
    named = {**own, "__qualname__": cls.__qualname__}
    kind: Any = type(cls)
    copy = standard(frozen=frozen, eq=eq)(kind(cls.__name__, cls.__bases__, named))
    for name in _made(written, frozen, eq):
        setattr(cls, name, vars(copy)[name])


def _leave_default(cls: type[Any], name: str, value: Field[Any]) -> None:
    """Leave the default in the class in place of its description, as the standard decorator does."""
    if value.default is MISSING:
        delattr(cls, name)
    else:
        setattr(cls, name, value.default)


def _freeze(cls: type[Any]) -> None:
    """Forbid changes, as the standard decorator does."""

    def __setattr__(self: object, name: str, value: object) -> None:
        if type(self) is cls or name in cls.__dataclass_fields__:
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: object, name: str) -> None:
        if type(self) is cls or name in cls.__dataclass_fields__:
            raise FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    cls.__setattr__ = __setattr__  # type: ignore[assignment]
    cls.__delattr__ = __delattr__  # type: ignore[assignment]


if TYPE_CHECKING:
    from dataclasses import dataclass
else:
    dataclass = deferred_dataclass

__all__ = ["dataclass", "deferred_dataclass"]
