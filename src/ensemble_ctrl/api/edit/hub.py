"""What the pages of an editor share: the session, its planner, and who is to be told of changes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from starlette.responses import JSONResponse, Response

from ensemble_ctrl.api.edit.pages import Event, Pages
from ensemble_ctrl.api.edit.planner import Planner, Wanted
from ensemble_ctrl.api.edit.session import Session
from ensemble_ctrl.core.errors import EnsembleError
from ensemble_ctrl.files.config.portable import problem_text

LOOK = 1.0
"""Seconds between two looks at the file on disk."""


class Hub(Pages):
    """Ties a session and a planner to the pages that are open.

    Parameters
    ----------
    session : Session
    until_closed : callable, optional
        Called once the last page has been closed for a while.
    """

    def __init__(self, session: Session, until_closed: Callable[[], None] | None = None) -> None:
        super().__init__(until_closed)
        self.session = session
        self.latest: list[Event] = []
        self._order = asyncio.Lock()
        self._planner = Planner(self._from_planner)
        self._planned_text: str | None = None
        self._tasks = {self._loop.create_task(self._watch())}
        self.plan()

    def state(self) -> Event:
        """What pages show."""
        return {"mode": "edit", **self.session.state()}

    def first(self) -> list[Event]:
        """The last plan, and what came after it."""
        return [{"kind": "plan", **what} for what in self.latest]

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
            self.tell({"kind": "state", **state})
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

    def close(self) -> None:
        """End the planner and every stream."""
        self.end_streams()
        for task in self._tasks:
            task.cancel()
        self._planner.close()

    def _from_planner(self, event: Event) -> None:
        """An event from the planner's thread."""
        self._loop.call_soon_threadsafe(self._keep, event)

    def _keep(self, event: Event) -> None:
        """Remember what a page that opens later is told first: the last plan, and what came after it."""
        if event["phase"] in ("planned", "failed"):
            self.latest = []
        self.latest = [one for one in self.latest if one["phase"] in ("planned", "failed", "suggested")]
        self.latest.append(event)
        self.tell({"kind": "plan", **event})

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
                    self.tell({"kind": "state", **self.state()})
                    self.plan()
