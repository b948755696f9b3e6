"""Loops with a margin taken out, which the campaign has to catch: what it can't see, it can't speak for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from unittest.mock import patch

import numpy as np

from ensemble_ctrl.certificate.remaining import certify_set
from ensemble_ctrl.planning.online import group, membership, propagation, tracker
from ensemble_ctrl.planning.online.evidence import Evidence
from ensemble_ctrl.planning.online.propagation import Commands, Errors, Factors, PoseSet
from ensemble_ctrl.planning.online.slips import Slips
from ensemble_ctrl.problem.uncertainty import NONE

from .world import Floats

WHERE = ("ensemble_ctrl.planning.online.membership.departure", "ensemble_ctrl.planning.online.tracker.departure")
true_departure = propagation.departure
true_past = tracker.Tracker._past
true_shown = certify_set
true_turned = Slips.turned


def nothing(
    commands: Commands, errors: Errors, factors: Factors, since: Floats, until: Floats, beyond: bool = False
) -> tuple[Floats, Floats]:
    """No departure: drift and errors of the model are not accounted for."""
    zero = np.zeros(np.broadcast(since, until).shape)
    return zero, zero


def of_now(self: tracker.Tracker, sets: membership.Membership, until: float) -> list[PoseSet] | None:
    """A past in which each set is that of the newest measurement."""
    found = true_past(self, sets, until)
    newest = sets.pose(self._commands, until)
    return found if found is None or newest is None else [newest] * len(found)


def in_the_middle(problem: object, ahead: Floats, away: float, turn: float, more: Floats) -> object:
    """A proof for the middle of the set of poses alone."""
    return true_shown(problem, ahead, 0.0, 0.0, more)  # type: ignore[arg-type]


def always_whole(self: object) -> object:
    """A proof that was of the task as it was read before counts for the task as it is read anew."""
    return self


def exactly_held(self: Slips, b: Floats, swerved: Floats, span: Floats, most: float) -> Floats:
    """A robot with a loop on its heading has the heading of its model."""
    free = true_turned(self, b, swerved, span, most)
    return free if self.hold is None else 0.0 * free


@contextmanager
def _departure() -> Iterator[None]:
    with patch(WHERE[0], nothing), patch(WHERE[1], nothing), patch.object(propagation, "departure", nothing):
        yield


@contextmanager
def _noise() -> Iterator[None]:
    true = membership.Membership.__init__

    def init(self: membership.Membership, fleet: object, errors: Errors) -> None:
        less = Errors(errors.position / 2, errors.heading / 2, errors.drift)
        true(self, fleet, less)  # type: ignore[arg-type]

    with patch.object(membership.Membership, "__init__", init):
        yield


CONTROLS: dict[str, Callable[[], AbstractContextManager[object]]] = {
    "drift and errors of the model left out": _departure,
    "errors of the model in no proof": lambda: patch.object(tracker.Tracker, "onwards", NONE),
    "a held heading taken for exact": lambda: patch.object(Slips, "turned", exactly_held),
    "half the noise": _noise,
    "the past where the robot is now": lambda: patch.object(tracker.Tracker, "_past", of_now),
    "the middle of the set of poses alone": lambda: patch(f"{group.__name__}.certify_set", in_the_middle),
    "old proofs of a task read anew": lambda: patch.object(Evidence, "of_a_period", always_whole),
}
