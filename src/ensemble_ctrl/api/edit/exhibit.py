"""What pages show that change nothing: a state, and events that add to it."""

from __future__ import annotations

from collections.abc import Callable

from ensemble_ctrl.api.edit.pages import Event, Pages


class Exhibit(Pages):
    """Something to look at.

    Parameters
    ----------
    state : dict
        What pages show, strict JSON data with its ``mode``.
    until_closed : callable, optional
        Called once the last page has been closed for a while.
    """

    def __init__(self, state: Event, until_closed: Callable[[], None] | None = None) -> None:
        super().__init__(until_closed)
        self._state = state
        self._past: list[Event] = []

    def state(self) -> Event:
        """What pages show."""
        return self._state

    def first(self) -> list[Event]:
        """All events so far but for those that newer ones have replaced."""
        return self._past

    def publish(self, event: Event) -> None:
        """Tell every page, also those that are opened later.

        Parameters
        ----------
        event : dict
            With its ``kind``; one with a ``slot`` replaces the last one of that slot.
        """
        slot = event.get("slot")
        if slot is not None:
            self._past = [one for one in self._past if one.get("slot") != slot]
        self._past.append(event)
        self.tell(event)
