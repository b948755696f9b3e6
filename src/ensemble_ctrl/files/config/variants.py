"""The problems of a sweep: one problem file under every combination of the values of its axes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from itertools import islice
from math import prod
from pathlib import Path
from typing import Any

from ensemble_ctrl.core.errors import ConfigError
from ensemble_ctrl.files.config.axes import Axis, axes_of
from ensemble_ctrl.files.config.errors import FieldError
from ensemble_ctrl.files.config.load import Loaded, parsed, text_from
from ensemble_ctrl.files.config.messages import Diagnostic, layout
from ensemble_ctrl.files.config.overrides import Given, parse_override
from ensemble_ctrl.files.config.source import Source
from ensemble_ctrl.files.config.tree import TextError


class Variants:
    """Problems by their numbers: the first axis changes slowest.

    Parameters
    ----------
    source : path, "-" or open file
        A problem file; its section ``sweep`` has axes.
    overrides : iterable of str
        ``KEY=VALUE``, applied before the values of the axes.
    axes : iterable of str
        Further axes, ``KEY=VALUES``; one that the file has too is taken from here.
    trust : bool
        As of `load`.

    Raises
    ------
    ConfigError
        If the file, or an axis, can't be used; also if every value of one axis is refused.
    """

    def __init__(
        self, source: Source, overrides: Iterable[Given] = (), axes: Iterable[str] = (), *, trust: bool = False
    ) -> None:
        self._text, self._overrides, self._trust = text_from(source), tuple(overrides), trust
        self.base: Loaded = parsed(self._text, self._overrides, trust)
        found = {axis.key: axis for axis in self.base.axes}
        for given in axes:
            found |= {axis.key: axis for axis in _given(given, self._text.folder)}
        self.axes: tuple[Axis, ...] = tuple(found.values())
        for axis in self.axes:
            self._check(axis)

    def __len__(self) -> int:
        return prod(len(axis.values) for axis in self.axes)

    def values(self, number: int) -> dict[str, Any]:
        """The values of a problem, by their keys."""
        found = {}
        for axis in reversed(self.axes):
            number, place = divmod(number, len(axis.values))
            found[axis.key] = axis.values[place]
        return dict(reversed(found.items()))

    def problem(self, number: int) -> Loaded:
        """A problem.

        Raises
        ------
        ConfigError
            If these values do not go together.
        """
        return self._with(self.values(number))

    def _with(self, values: dict[str, Any]) -> Loaded:
        """The problem with some values."""
        changes = [(f"sweep: {key}", f"{key}={json.dumps(value)}") for key, value in values.items()]
        return parsed(self._text, [*self._overrides, *changes], self._trust)

    def _check(self, axis: Axis) -> None:
        """Make sure that at least one of an axis's first values can be used."""
        refusal: ConfigError | None = None
        for value in islice(axis.values, MOST_TRIED):
            try:
                self._with({axis.key: value})
                return
            except ConfigError as error:
                refusal = refusal or error
        if refusal is not None:
            raise refusal


MOST_TRIED = 20
"""Values of an axis that are tried before it is refused."""


def _given(text: str, folder: Path) -> Sequence[Axis]:
    """Axes of an option ``--axis KEY=VALUES``."""
    name = f"--axis {text}"
    try:
        key, _, values = text.partition("=")
        if isinstance(parse_override(text).value, list | dict):
            return axes_of({key.strip(): parse_override(text).value}, folder)
        raise FieldError(
            f"expected a list or a section of values, got {values!r}", "for example  --axis solve.seed=[1,2,3]"
        )
    except (FieldError, TextError) as error:
        found = Diagnostic(name, None, None, "error", "", error.message, error.hint)
        raise ConfigError(layout([found], name), (found,)) from None
