"""Values that nobody changes, also after they were sent to another process."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import numpy as np

Value = TypeVar("Value")


class ReadOnlyMapping(Mapping[str, Value]):
    """A copy of a mapping that can't be changed, but pickled and copied.

    Examples
    --------
    >>> ReadOnlyMapping({"a": 1})
    {'a': 1}
    """

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Value]) -> None:
        self._items = dict(items)

    def __getitem__(self, name: str) -> Value:
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __or__(self, other: Mapping[str, Value]) -> dict[str, Value]:
        return self._items | dict(other)

    def __ror__(self, other: Mapping[str, Value]) -> dict[str, Value]:
        return dict(other) | self._items

    def __repr__(self) -> str:
        return repr(self._items)


class ReadOnlyArrays:
    """Base of data whose arrays stay read-only in a copy: NumPy makes the arrays of a copy writable."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)
