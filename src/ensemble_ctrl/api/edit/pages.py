"""The pages that are open on one server: what they show, and how they are told of changes."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

AHEAD = 200
"""Events that wait for one page; one that reads none of them is left behind."""
ALONE = 3.0
"""Seconds after the last page was closed after which that counts: one that is loaded anew is closed for a moment."""
Event = dict[str, Any]


class Pages(ABC):
    """What pages show, and their streams of events.

    Parameters
    ----------
    until_closed : callable, optional
        Called once the last page has been closed for a while.

    Attributes
    ----------
    closing : asyncio.Event
        Set when streams are to end.
    """

    def __init__(self, until_closed: Callable[[], None] | None = None) -> None:
        self._until_closed = until_closed
        self.closing = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._queues: set[asyncio.Queue[Event]] = set()
        self._alone: asyncio.TimerHandle | None = None

    @property
    def count(self) -> int:
        """Pages that are open."""
        return len(self._queues)

    @property
    def left(self) -> bool:
        """Whether pages were open, and none is now."""
        return self._alone is not None and not self._queues

    @abstractmethod
    def state(self) -> Event:
        """What a page shows that is opened now."""

    @abstractmethod
    def first(self) -> list[Event]:
        """Events that a page is told first, after the state."""

    @contextmanager
    def listening(self) -> Iterator[asyncio.Queue[Event]]:
        """Within: a page that is told of everything."""
        queue: asyncio.Queue[Event] = asyncio.Queue(AHEAD)
        self._queues.add(queue)
        if self._alone is not None:
            self._alone.cancel()
        try:
            yield queue
        finally:
            self._queues.discard(queue)
            if not self._queues and self._until_closed is not None:
                self._alone = self._loop.call_later(ALONE, self._until_closed)

    def end_streams(self) -> None:
        """Let every page know that this is the end."""
        self.closing.set()
        self.tell({"kind": "end"})

    def close(self) -> None:
        """End every stream."""
        self.end_streams()

    def tell(self, event: Event) -> None:
        """Give an event to every page."""
        for queue in list(self._queues):
            if queue.full():
                self._queues.discard(queue)
            else:
                queue.put_nowait(event)
