"""Units on a Dask cluster (extra ``cluster``): each thread of its workers has one worker process of ours.

A unit that ends its process thus ends none of the cluster's own workers, and is computed just as on this machine.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import field
from typing import Any

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError, WorkerError
from ensemble_ctrl.core.jobs.child import Asked, Child, Died, asked_of, is_spent
from ensemble_ctrl.core.jobs.unit import DEATHS, LATE, Outcome, Stop, Unit
from ensemble_ctrl.core.jobs.versions import versions

WAIT = 0.2
"""Seconds after which the wish to stop is looked at again."""
CONNECT = 15
"""Seconds in which the scheduler has to answer."""
AHEAD = 2
"""Units that are sent for each thread, so that none waits for the network."""
_HERE = threading.local()
"""The worker process of this thread, on a worker of the cluster."""
_BUSY: dict[str, Child] = {}
"""Those at work, by the key of their task."""


def compute(key: str, text: str, asked: Asked, wanted: dict[str, str]) -> dict[str, Any]:
    """Compute one unit; runs on a worker of the cluster.

    Returns
    -------
    dict
        The answer of the worker process, or ``{"died": how}`` if it ended.
    """
    child = getattr(_HERE, "child", None)
    if child is None or not child.alive or child.versions != wanted or asked["alone"]:
        if child is not None:
            child.end()
        child = _HERE.child = Child(wanted)
    _BUSY[key] = child
    try:
        child.ask(asked, text)
        answer = child.finished()
    except Died as death:
        answer = {"died": str(death)}
    del _BUSY[key]
    if "died" in answer or is_spent(asked, answer):
        child.end()
        _HERE.child = None
    return answer


def give_up(keys: list[str]) -> None:
    """End the worker processes that are at work on some tasks; runs on each worker of the cluster."""
    for key in keys:
        child = _BUSY.get(key)
        if child is not None:
            child.kill()


def content(text: str) -> str:
    """A content, as the tasks on it take it: computed again from the client's message if its worker is lost."""
    return text


@contextmanager
def _connected() -> Iterator[None]:
    """Within: the end of the scheduler is an error of ours."""
    try:
        yield
    except (OSError, CancelledError) as error:
        raise WorkerError(f"the Dask scheduler does not answer any more ({type(error).__name__})") from None


@dataclass(eq=False)
class Dask:
    """A Dask cluster.

    Attributes
    ----------
    client : distributed.Client
        Connected to its scheduler.
    """

    client: Any
    _sent: dict[Any, tuple[Unit, int]] = field(default_factory=dict)
    _again: deque[tuple[Unit, int]] = field(default_factory=deque)
    _content: tuple[str, Any] = ("", None)
    _order: int = 0

    @classmethod
    def connected(cls, address: str) -> Dask:
        """Connect to a scheduler; see `Cluster.backend`."""
        try:
            import distributed
        except ImportError:
            raise UnsupportedError(
                f"--cluster {address} needs the library distributed: pip install 'ensemble-ctrl[cluster]'"
            ) from None
        library: Any = distributed
        try:
            return cls(library.Client(address, timeout=CONNECT, set_as_default=False))
        except (OSError, TimeoutError) as error:
            raise WorkerError(f"{address}: expected a Dask scheduler, found none ({error})") from None

    @property
    def workers(self) -> int:
        """Threads of all its workers."""
        return sum(self.client.nthreads().values())

    def outcomes(self, units: Iterator[Unit], stop: Stop) -> Iterator[Outcome]:
        """What comes of units; see `Backend`."""
        threads, looked = self.workers, time.monotonic()
        try:
            while not stop():
                if time.monotonic() - looked > 5:
                    threads, looked = self.workers, time.monotonic()
                self._feed(units, AHEAD * max(threads, 1))
                if not self._sent:
                    return
                for future in self._ended():
                    yield from self._outcome(future)
        finally:
            self._close()

    def _ended(self) -> set[Any]:
        """Tasks that have ended; waits for one, but not for long."""
        import distributed

        library: Any = distributed
        with _connected(), self.client.as_current():
            try:
                return set(library.wait(list(self._sent), timeout=WAIT, return_when="FIRST_COMPLETED").done)
            except TimeoutError:
                return set()

    def _feed(self, units: Iterator[Unit], most: int) -> None:
        """Send units: first those whose worker ended."""
        while len(self._sent) < most:
            unit, deaths = self._again.popleft() if self._again else (next(units, None), 0)
            if unit is None:
                return
            key, self._order = f"{unit.key}:{deaths}", self._order + 1
            arguments = key, self._text(unit), asked_of(unit), versions()
            # without a priority, Dask takes units that are sent in a row in any order
            future = self.client.submit(compute, *arguments, key=key, pure=True, priority=-self._order)
            self._sent[future] = unit, deaths

    def _text(self, unit: Unit) -> Any:
        """The content of a unit, sent once as long as units of the same one follow each other."""
        digest = unit.content.digest
        if self._content[0] != digest:
            self._content = digest, self.client.submit(content, unit.content.text, key=f"content:{digest}", pure=True)
        return self._content[1]

    def _outcome(self, future: Any) -> Iterator[Outcome]:
        """What came of one that ended; nothing yet if it is tried again."""
        unit, deaths = self._sent.pop(future)
        if future.status != "finished":
            yield self._lost(unit, future)
            return
        with _connected():
            answer = future.result()
        if "died" not in answer:
            yield Outcome(unit, **answer)
        elif deaths + 1 < DEATHS and answer["died"] != LATE:
            self._again.append((unit, deaths + 1))
        else:
            yield Outcome(unit, killed=answer["died"])

    def _lost(self, unit: Unit, future: Any) -> Outcome:
        """A task that the cluster itself could not do."""
        from distributed import KilledWorker

        error = future.exception() if future.status == "error" else None
        if isinstance(error, KilledWorker):
            return Outcome(unit, killed="workers of the cluster that were lost")
        if isinstance(error, WorkerError):
            raise error
        raise WorkerError(f"the cluster can't compute {unit.name}: {future.status}" + (f" ({error})" if error else ""))

    def _close(self) -> None:
        """Give up what is at work, and leave nothing of it on the cluster."""
        try:
            if self._sent:
                self.client.cancel(list(self._sent), force=True)
                self.client.run(give_up, [future.key for future in self._sent])
            self._sent.clear()
        except (OSError, RuntimeError, TimeoutError):  # the scheduler is gone
            pass
        self.client.close(timeout=2)
