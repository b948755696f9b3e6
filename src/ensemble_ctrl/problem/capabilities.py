"""What a problem may use of its system: one table of features, each with what it needs and why.

No module checks the type of a system.  A feature needs a trait of the system, such as one transcription or an exact
flow on arcs; where that is missing, the refusal names the feature, the system and the reason.  The checks of a
problem refuse from this table what the problem uses, and the commands refuse what they do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal

from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import UnsupportedError

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem
    from ensemble_ctrl.systems import System

TRAITS: Mapping[str, Callable[[type[System] | System], bool]] = {
    "positions": lambda system: system.transcription == "positions",
    "arcs": lambda system: system.on_arcs,
    "any": lambda system: True,
}
"""What a feature may need of a system: a program in positions, exact arcs, or nothing."""


@dataclass(frozen=True)
class Refusal:
    """That a feature is not for a system; false.

    Attributes
    ----------
    message : str
        The feature, the system, and the reason.
    hint : str
        What to do instead.
    """

    message: str
    hint: str = ""

    def __bool__(self) -> bool:
        return False


@dataclass(frozen=True)
class Feature:
    """One row of the table.

    Attributes
    ----------
    words : str
        The feature in words.
    needs : str
        A name of `TRAITS`.
    why : str
        What it uses that trait for: the reason of a refusal.
    path : tuple of str
        The key of a problem file that turns it on, if there is one.
    hint : str
        What to do where it is not there.
    requested : callable
        Whether a problem uses it.
    plural : bool
        Of the words.
    bodies : str
        Why it is not for fleets with a footprint; empty where it is.
    """

    words: str
    needs: str = "any"
    why: str = ""
    path: tuple[str, ...] = ()
    hint: str = ""
    requested: Callable[[Problem], bool] = lambda problem: False
    plural: bool = False
    bodies: str = ""


FEATURES: Mapping[str, Feature] = {
    "moment": Feature(
        "the guarantee moment",
        path=("solve", "guarantee"),
        requested=lambda problem: problem.solve.guarantee == "moment",
        bodies="it is about the mean position",
    ),
    "modal": Feature(
        "modal",
        "arcs",
        "its moment system is bilinear in the commands of robots on arcs",
        ("moments", "coordinates"),
        "use nodal",
        lambda problem: problem.coordinates == "modal",
        bodies="its moments are those of the position",
    ),
    "minlp": Feature(
        "minlp",
        path=("solve", "method"),
        requested=lambda problem: problem.solve.method == "minlp",
        bodies="its binaries choose facets for points",
    ),
    "targets": Feature("formations, moments and spreads as targets", plural=True),
    "online": Feature("online replanning", bodies="its sets of poses are kept out as disks"),
    "suggest": Feature("a search for what would help"),
    "risk": Feature(
        "a risk penalty",
        path=("objective", "cvar"),
        requested=lambda problem: problem.objective.cvar is not None,
        bodies="it is taken of the distance of points",
    ),
    "uncertainty": Feature(
        "uncertainty",
        path=("fleet", "uncertainty"),
        requested=lambda problem: bool(problem.fleet.uncertainty) or problem.objective.tolerance is not None,
        bodies="errors of the heading, which move the corners of bodies, are not bounded",
    ),
    "footprint": Feature(
        "a footprint",
        "arcs",
        "bodies are enclosed by the exact headings of robots on arcs",
        ("fleet", "footprint"),
        "use radius",
        lambda problem: problem.fleet.footprint is not None,
    ),
    "moving obstacles": Feature("moving obstacles", plural=True),
    "keep-out zones": Feature("keep-out zones", plural=True),
    "speed limits": Feature(
        "speed limits of zones",
        "arcs",
        "they are on the one speed of robots on arcs",
        ("zones",),
        "write bounds of its velocities in the task",
        lambda problem: any(zone.speed is not None for zone in problem.zones.values()),
        True,
        "bodies are kept out throughout, and these allow them in at a speed",
    ),
    "terrain": Feature(
        "terrain",
        "arcs",
        "patches change the factors on the speed and the turn rate of robots on arcs",
        ("terrain",),
        "give fleet.uncertainty.varies, which holds everywhere",
        lambda problem: bool(problem.terrain),
        bodies="patches change headings, which move the corners of bodies",
    ),
    "cells": Feature("cells", plural=True),
    "baseline": Feature("the unconstrained baseline"),
    "earliest": Feature("the earliest passage"),
    "free duration": Feature("a free duration"),
    "compare": Feature("compare"),
    "widest": Feature("widest"),
    "channels": Feature("broadcast channels", plural=True),
    "share": Feature("share(p, f) of the fleet"),
    "proof": Feature("a certificate for all members and times"),
    "export": Feature("exports to CSV, JSON, ROS 2 and GeoJSON"),
    "animation": Feature("animations"),
}
"""Every feature by its name: what `supports` knows."""


def supports(problem: Problem, feature: str) -> Literal[True] | Refusal:
    """Whether a feature is for a problem's system.

    Parameters
    ----------
    problem : Problem
    feature : str
        A name of `FEATURES`.

    Returns
    -------
    True or Refusal
        A refusal is false, and gives the reason.
    """
    row, found = FEATURES[feature], allows(problem.fleet.system, feature)
    if found and row.bodies and problem.fleet.footprint is not None:
        verb = "are" if row.plural else "is"
        return Refusal(f"{row.words} {verb} not for fleets with a footprint: {row.bodies}", "use radius")
    return found


def allows(system: type[System] | System, feature: str) -> Literal[True] | Refusal:
    """As `supports`, of a system alone."""
    row = FEATURES[feature]
    if TRAITS[row.needs](system):
        return True
    subject = f"{row.words} are not for the" if row.plural else f"{row.words} is not for the"
    return Refusal(f"{subject} {system.name}: {row.why}", row.hint)


def require(problem: Problem, feature: str) -> None:
    """Refuse what a problem's system does not support.

    Raises
    ------
    UnsupportedError
        With the reason.
    """
    found = supports(problem, feature)
    if not found:
        raise UnsupportedError(found.message)
