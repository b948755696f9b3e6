"""One piece of work, and what came of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, Protocol

from ensemble_ctrl.core.deferred import dataclass

DEATHS = 3
"""Workers that a unit may end before it is left out."""
LATE = "ended by SIGALRM"
"""How a worker ends whose unit takes longer than its limit."""
Stop = Callable[[], bool]
"""Whether to begin no more units, and to leave those that are at work."""


@dataclass(frozen=True, eq=False)
class Content:
    """What units are about: sent once to each worker, and known by its hash.

    Attributes
    ----------
    text : str
        As the module of the unit's kind reads it.
    """

    text: str

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Unit:
    """A piece of work: a pure function of its kind, its content and its index.

    Attributes
    ----------
    kind : str
        Full name of the module that does it. Its function ``prepare(text)`` reads a content, once for all units of it
        on one worker; ``run(prepared, index)`` returns strict JSON data.
    content : Content
        What it is about.
    index : int
        Which part of it.
    name : str
        What messages call it.
    limit : float
        Seconds after which it is given up, without another try; 0 for any time.
    alone : bool
        Whether it has a worker of its own, so that its time does not depend on what others left in memory.
    """

    kind: str
    content: Content
    index: int = 0
    name: str = ""
    limit: float = 0.0
    alone: bool = False

    @property
    def key(self) -> str:
        """The unit in one word, the same in every run."""
        return f"{self.kind}:{self.content.digest}:{self.index}"


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a unit: a result, or why there is none.

    Attributes
    ----------
    unit : Unit
    result : any JSON data
        What its function returned; None without a result.
    error : str
        The exception that it raised, in words; empty without one.
    killed : str
        How the last worker ended that was given it: of `DEATHS`, or the first if that was by the limit; empty if it
        is not left out.
    seconds : float
        What it took; 0 if it was kept from an earlier run.
    memory : int
        Largest resident set of its worker so far, bytes; 0 where that is not known.
    """

    unit: Unit
    result: Any = None
    error: str = ""
    killed: str = ""
    seconds: float = 0.0
    memory: int = 0

    @property
    def late(self) -> bool:
        """Whether it was given up at its limit."""
        return self.killed == LATE

    @property
    def failure(self) -> str:
        """Why there is no result, with the unit's name; empty if there is one."""
        if self.late:
            return f"{self.unit.name}: given up after {self.unit.limit:g} s"
        if self.killed:
            return f"{self.unit.name}: left out after it ended {DEATHS} workers ({self.killed})"
        return f"{self.unit.name}: {self.error}" if self.error else ""


class Backend(Protocol):
    """Where units are computed."""

    @property
    def workers(self) -> int:
        """Units at work side by side."""

    def outcomes(self, units: Iterator[Unit], stop: Stop) -> Iterator[Outcome]:
        """What comes of units, each once, as they end; takes no more of them than its workers need."""
