"""What the pages of an editor share: the session, its planner, and who is to be told of changes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from starlette.responses import JSONResponse, Response

from ensemble_ctrl.api.edit.planner import Planner, Wanted
from ensemble_ctrl.api.edit.session import Session
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config.portable import problem_text

LOOK = 1.0
"""Seconds between two looks at the file on disk."""
AHEAD = 200
"""Events that wait for one page; one that reads none of them is left behind."""
Event = dict[str, Any]


class Hub:
    """Ties a session and a planner to the pages that are open.

    Parameters
    ----------
    session : Session
    until_closed : callable, optional
        Called once the last page has been closed for a while.
    """

    def __init__(self, session: Session, until_closed: Callable[[], None] | None = None) -> None:
        self.session, self._until_closed = session, until_closed
        self.closing = asyncio.Event()
        self.latest: list[Event] = []
        self._loop = asyncio.get_running_loop()
        self._queues: set[asyncio.Queue[Event]] = set()
        self._order = asyncio.Lock()
        self._planner = Planner(self._from_planner)
        self._planned_text: str | None = None
        self._tasks = {self._loop.create_task(self._watch())}
        self._alone: asyncio.TimerHandle | None = None
        self.plan()

    def state(self) -> Event:
        """What pages show."""
        return self.session.state()

    @property
    def planner_pid(self) -> int | None:
        """The process that plans, once there is one."""
        return self._planner.pid

    async def change(self, action: Callable[[], None], dragging: bool = False) -> Response:
        """Change the session, in a thread and one change after the other; answers with the new state."""
        async with self._order:
            before = self.session.revision
            await asyncio.to_thread(action)
            state = self.state()
            self._tell({"kind": "state", **state})
            if self.session.revision != before or not dragging:
                self.plan(dragging)
        return JSONResponse(state)

    def plan(self, dragging: bool = False) -> None:
        """Have the text planned as it is now, unless that is being done."""
        checked = self.session.checked
        if checked.problem is None:
            self._planner.want(None)
            self._planned_text = None
            return
        if self._planned_text == checked.text:
            return
        # after a drag's last change the same text is planned again, as a whole
        self._planned_text = None if dragging else checked.text
        self._planner.want(Wanted(self.session.revision, problem_text(checked.problem), dragging))

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
                self._alone = self._loop.call_later(3.0, self._until_closed)

    def end_streams(self) -> None:
        """Let every page know that this is the end."""
        self.closing.set()
        self._tell({"kind": "end"})

    def close(self) -> None:
        """End the planner and every stream."""
        self.end_streams()
        for task in self._tasks:
            task.cancel()
        self._planner.close()

    def _tell(self, event: Event) -> None:
        """Give an event to every page."""
        for queue in list(self._queues):
            if queue.full():
                self._queues.discard(queue)
            else:
                queue.put_nowait(event)

    def _from_planner(self, event: Event) -> None:
        """An event from the planner's thread."""
        self._loop.call_soon_threadsafe(self._keep, event)

    def _keep(self, event: Event) -> None:
        """Remember what a page that opens later is told first: the last plan, and what came after it."""
        if event["phase"] in ("planned", "failed"):
            self.latest = []
        self.latest = [one for one in self.latest if one["phase"] in ("planned", "failed", "suggested")]
        self.latest.append(event)
        self._tell({"kind": "plan", **event})

    def _noticed(self) -> tuple[int, bool, bool]:
        """What a look at the file may change."""
        return self.session.revision, self.session.disk.changed, self.session.disk.missing

    async def _watch(self) -> None:
        """Look at the file now and then."""
        while True:
            await asyncio.sleep(LOOK)
            before = self._noticed()
            async with self._order:
                with suppress(EnsembleError):  # it can't be read now: that it has changed is shown
                    await asyncio.to_thread(self.session.look)
                if self._noticed() != before:
                    self._tell({"kind": "state", **self.state()})
                    self.plan()
