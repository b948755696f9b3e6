"""One planner for an editor: the newest problem is planned in a worker process, and an older one is given up.

A second worker is kept ready, so that one that does not give up in time, or dies, costs no start of Python.
"""

from __future__ import annotations

import json
import os
import select
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import field
from typing import Any

from ensemble_ctrl.api.edit.work import CONTINUED, NUMBER, SUGGESTED, WHOLE
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import WorkerError
from ensemble_ctrl.core.jobs.child import Child, Died, asked_of, is_spent
from ensemble_ctrl.core.jobs.unit import DEATHS, Content, Unit
from ensemble_ctrl.core.jobs.versions import versions

KIND = "ensemble_ctrl.api.edit.work"
"""The module that does the work."""
GRACE = 1.5
"""Seconds that a worker is given to give up a problem that is out of date."""
PATIENCE = 2.0
"""Seconds of planning that a change in the middle of a drag does not interrupt."""
TICK = 0.2
"""Seconds after which the clock is looked at again."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A problem to plan.

    Attributes
    ----------
    revision : int
        Of the text that it comes from.
    problem : str
        As `ensemble_ctrl.files.config.portable` writes it.
    dragging : bool
        Whether more changes will follow at once: then it is planned from the last plan only.
    """

    revision: int
    problem: str
    dragging: bool = False


@dataclass(eq=False)
class Planner:
    """Plans the newest problem that it was given, in a thread of its own.

    Parameters
    ----------
    publish : callable
        Told of each stage as plain data with ``revision`` and ``phase``: planning, planned, suggesting, suggested,
        failed, idle.
    """

    publish: Callable[[dict[str, Any]], None]
    pid: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._change = threading.Condition()
        self._wanted: Wanted | None = None
        self._closed = False
        self._ticket = 0
        self._guess: list[list[float]] | None = None
        self._wake_out, self._wake_in = os.pipe()
        self._stop = tempfile.NamedTemporaryFile(prefix="ensemble-plan-edit-")  # noqa: SIM115
        self._give_up(0)
        self._thread = threading.Thread(target=self._run, name="planner", daemon=True)
        self._thread.start()

    def want(self, wanted: Wanted | None) -> None:
        """Plan this one next, or nothing."""
        with self._change:
            self._wanted = wanted or Wanted(-1, "")
            self._change.notify()
        os.write(self._wake_in, b"x")

    def close(self) -> None:
        """End the worker processes and the thread."""
        with self._change:
            self._closed = True
            self._change.notify()
        os.write(self._wake_in, b"x")
        self._thread.join(timeout=10)

    def _run(self) -> None:
        """The thread: workers end with it."""
        self._child, self._spare = Child(versions()), Child(versions())
        try:
            while (wanted := self._next()) is not None:
                try:
                    self._serve(wanted)
                except Exception as error:  # the page is told, and the next problem has a worker again
                    self._say(wanted, "failed", why=f"the planner failed: {type(error).__name__}: {error}")
                    self._replace()
        finally:
            for child in (self._child, self._spare):
                child.end()
            self._stop.close()

    def _next(self) -> Wanted | None:
        """Wait for a problem; None at the end."""
        with self._change:
            while self._wanted is None and not self._closed:
                self._change.wait()
            wanted, self._wanted = self._wanted, None
            return None if self._closed else wanted

    def _serve(self, wanted: Wanted) -> None:
        """All stages of one problem, until a newer one is there."""
        if not wanted.problem:
            return
        self._ticket += 1
        asked = {"problem": wanted.problem, "guess": self._guess, "ticket": self._ticket, "stop": self._stop.name}
        content = Content(json.dumps(asked))
        self._say(wanted, "planning")
        quick = self._stage(wanted, content, CONTINUED) if self._guess else None
        if quick is not None and "error" in quick:  # what can't be continued can still be planned
            quick = None
        if quick is not None:
            self._planned(wanted, quick, whole=False)
        if (wanted.dragging and quick is not None) or self._newer():
            return
        whole = self._stage(wanted, content, WHOLE)
        if whole is None:
            return
        if "error" in whole:
            self._say(wanted, "failed", why=whole["error"])
            return
        self._planned(wanted, whole, kept=quick is not None)
        if not whole["drawing"]["proven"] and whole["drawing"]["status"] in ("infeasible", "limit"):
            self._say(wanted, "suggesting")
            found = self._stage(wanted, content, SUGGESTED)
            if found is not None:
                self._say(wanted, "suggested", **found)
        self._say(wanted, "idle")

    def _planned(self, wanted: Wanted, found: dict[str, Any], whole: bool = True, kept: bool = False) -> None:
        """Tell of a plan; one that is proven is where the next search starts, and is not given up for less."""
        proven = found["drawing"]["proven"]
        if kept and not proven:
            return
        if proven:
            self._guess = found["controls"]
        facts = {"seconds": found["seconds"], "whole": whole, "why": found.get("why", "")}
        self._say(wanted, "planned", drawing=found["drawing"], **facts)

    def _say(self, wanted: Wanted, phase: str, **more: Any) -> None:
        """Tell of a stage."""
        self.publish({"revision": wanted.revision, "phase": phase, **more})

    def _newer(self) -> bool:
        """Whether there is another problem, or no more to do."""
        return self._wanted is not None or self._closed

    def _stage(self, wanted: Wanted, content: Content, index: int) -> dict[str, Any] | None:
        """One stage; None where it found nothing, or was given up."""
        for _ in range(DEATHS):
            try:
                asked = asked_of(Unit(KIND, content, index))
                self._child.ask(asked, content.text)
                self.pid = self._child.pid
                answer = self._answer()
            except (Died, WorkerError) as error:
                self._replace()
                why = str(error)
                if self._newer():
                    return None
                continue
            if answer is not None and is_spent(asked, answer):
                self._replace()
            if answer is None or self._newer():
                return None
            if answer["error"]:
                return {"error": answer["error"]}
            result: dict[str, Any] | None = answer["result"]
            return result
        return {"error": f"the planner's process ended {DEATHS} times: {why}"}

    def _answer(self) -> dict[str, Any] | None:
        """What the worker answers; None if it was given up and did not answer in time."""
        began, given_up = time.monotonic(), 0.0
        while True:
            ready, _, _ = select.select([self._child.fileno(), self._wake_out], [], [], TICK)
            if self._wake_out in ready:
                os.read(self._wake_out, 1 << 16)
            if self._child.fileno() in ready and (found := self._child.answer()) is not None:
                return found
            now = time.monotonic()
            if not given_up and self._due(now - began):
                self._give_up(self._ticket)
                given_up = now
            if given_up and now - given_up > GRACE:
                self._replace()
                return None

    def _due(self, seconds: float) -> bool:
        """Whether what is at work is to be given up; in the middle of a drag it is given some time."""
        if self._closed:
            return True
        newer = self._wanted
        return newer is not None and (not newer.dragging or seconds > PATIENCE)

    def _give_up(self, ticket: int) -> None:
        """Say up to which ticket work is out of date."""
        self._stop.seek(0)
        self._stop.write(NUMBER.pack(ticket))
        self._stop.flush()

    def _replace(self) -> None:
        """The spare worker takes over, and a new spare is started."""
        self._child.end()
        if not self._spare.alive:
            self._spare.end()
            self._spare = Child(versions())
        self._child, self._spare = self._spare, Child(versions())
