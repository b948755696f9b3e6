"""Units on worker processes of this machine."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from dataclasses import field
from selectors import EVENT_READ, DefaultSelector
from typing import Any

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.jobs.child import Child, Died, asked_of, is_spent
from ensemble_ctrl.core.jobs.unit import DEATHS, LATE, Outcome, Stop, Unit
from ensemble_ctrl.core.jobs.versions import versions

WAIT = 0.2
"""Seconds after which the wish to stop is looked at again."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(eq=False)
class Processes:
    """Worker processes, no more of them than there are units at any time.

    Attributes
    ----------
    workers : int
        How many.
    """

    workers: int
    _busy: dict[Child, Unit] = field(default_factory=dict)
    _idle: list[Child] = field(default_factory=list)
    _again: deque[Unit] = field(default_factory=deque)
    _deaths: dict[Unit, int] = field(default_factory=dict)

    def outcomes(self, units: Iterator[Unit], stop: Stop) -> Iterator[Outcome]:
        """What comes of units; see `Backend`.

        Notes
        -----
        *Guarantee*: no worker is running any more after its end, also by an exception or when it is closed.
        """
        try:
            with DefaultSelector() as selector:
                while not stop():
                    yield from self._feed(units, selector)
                    if not self._busy:
                        return
                    for key, _ in selector.select(WAIT):
                        yield from self._hear(key.fileobj, selector)
        finally:
            for child in [*self._busy, *self._idle]:
                child.end()
            self._busy, self._idle = {}, []

    def _feed(self, units: Iterator[Unit], selector: DefaultSelector) -> Iterator[Outcome]:
        """Give each worker that waits a unit: first those whose worker ended."""
        while len(self._busy) < self.workers:
            unit = self._again.popleft() if self._again else next(units, None)
            if unit is None:
                return
            child = Child(versions()) if unit.alone else self._free()
            self._busy[child] = unit
            selector.register(child, EVENT_READ)
            try:
                child.ask(asked_of(unit), unit.content.text)
            except Died as death:
                yield from self._buried(child, str(death), selector)

    def _free(self) -> Child:
        """A worker that waits, or a new one: those that waited for long have ended."""
        while self._idle:
            child = self._idle.pop()
            if child.alive:
                return child
            child.end()
        return Child(versions())

    def _hear(self, child: Any, selector: DefaultSelector) -> Iterator[Outcome]:
        """Take what a worker says."""
        try:
            answer = child.answer()
        except Died as death:
            yield from self._buried(child, str(death), selector)
            return
        if answer is None:
            return
        selector.unregister(child)
        unit = self._busy.pop(child)
        if is_spent(asked_of(unit), answer):
            child.end()
        else:
            self._idle.append(child)
        self._deaths.pop(unit, None)
        yield Outcome(unit, **answer)

    def _buried(self, child: Child, how: str, selector: DefaultSelector) -> Iterator[Outcome]:
        """A worker that ended: its unit is tried again on another, but not for ever, nor once it was too slow."""
        selector.unregister(child)
        unit = self._busy.pop(child)
        self._deaths[unit] = self._deaths.get(unit, 0) + 1
        if self._deaths[unit] < DEATHS and how != LATE:
            self._again.append(unit)
        else:
            del self._deaths[unit]
            yield Outcome(unit, killed=how)
