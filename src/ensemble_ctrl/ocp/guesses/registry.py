"""First guesses, by protocol, in one registry: what makes them, and when it is asked."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.ocp.parametrisation import Iterate
from ensemble_ctrl.problem import Problem

Floats = NDArray[np.float64]
T = TypeVar("T")
Stop = Callable[[], bool]
"""Whether to stop now with what there is."""


@dataclass(frozen=True, eq=False)
class Guess:
    """Where the fleet may go.

    Attributes
    ----------
    controls : ndarray, shape (steps, n_u)
        Commands.
    corners : ndarray, shape (corners, d)
        The way that it follows, metres; empty where it follows none.
    length : float
        Of the way, metres.
    visits : tuple of str
        Regions in the order they are visited.
    name : str
        What sets it apart from other guesses: on which side of the way each obstacle lies, or what is visited.
    kind : str
        What it was made from: a route, a curve, or other commands.
    states : ndarray, shape (steps + 1, n_x, 1), optional
        Of the middle member along the way; empty if not given.
    """

    controls: Floats
    corners: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    length: float = 0.0
    visits: tuple[str, ...] = ()
    name: str = "given"
    kind: str = "route"
    states: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))

    @property
    def iterate(self) -> Iterate:
        """What the program starts from."""
        return Iterate(self.controls, self.states)


class SideBySide(Protocol):
    """Runs independent pieces of work, in processes of their own where there are any."""

    def __call__(self, phase: str, work: Callable[[Stop, int], T], count: int) -> list[T | None]:
        """The results of ``work(stop, 0)`` to ``work(stop, count - 1)``; None for what was not finished."""


def one_after_another(phase: str, work: Callable[[Stop, int], T], count: int) -> list[T | None]:
    """The same in this process."""
    return [work(lambda: False, k) for k in range(count)]


def unlimited() -> float:
    """No limit of time."""
    return math.inf


@dataclass(frozen=True, eq=False)
class Request:
    """What guesses are made for.

    Attributes
    ----------
    problem : Problem
    steps : int
        Of each guess.
    best : ndarray, shape (steps, n_u), optional
        Commands of the best attempt so far, where others were tried.
    quick : bool
        Whether there is little time: what takes seconds is left out.
    side_by_side : callable
    left : callable
        Seconds that are left.
    """

    problem: Problem
    steps: int
    best: Floats | None = None
    quick: bool = False
    side_by_side: SideBySide = one_after_another
    left: Callable[[], float] = unlimited


class Source(Protocol):
    """Makes guesses."""

    @property
    def at_once(self) -> bool:
        """Whether it is asked at once; otherwise where all that was tried led to no good plan."""

    def accepts(self, problem: Problem) -> bool:
        """Whether it can make guesses for a problem's fleet."""

    def propose(self, request: Request) -> Iterator[list[Guess]]:
        """Guesses, a few at a time: the next few are asked for where these led to no good plan."""


GUESSES: dict[str, Source] = {}
"""By name, in the order in which they are asked."""


def first_guesses(request: Request) -> list[Guess]:
    """The first few of every source that is asked at once."""
    return [guess for source in _accepting(request, at_once=True) for guess in next(source.propose(request), [])]


def further_rounds(request: Request) -> Iterator[Iterator[list[Guess]]]:
    """What the other sources propose: in each round the next few of every source in turn."""
    sources = [source.propose(request) for source in _accepting(request, at_once=False)]

    def next_few() -> Iterator[list[Guess]]:
        for source in list(sources):
            guesses = next(source, None)
            if guesses is None:
                sources.remove(source)
            else:
                yield guesses

    while sources:
        yield next_few()


def _accepting(request: Request, at_once: bool) -> list[Source]:
    """Sources for this problem."""
    return [s for s in GUESSES.values() if s.at_once == at_once and s.accepts(request.problem)]
