"""A plan as data that the page draws: ways in metres, the tube, what fails and where, charts and words."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import CounterExample
from ensemble_ctrl.problem.evaluation.sampled import all_paths, trajectories
from ensemble_ctrl.problem.starts import by_start, label
from ensemble_ctrl.report.html import cards, verdict_class
from ensemble_ctrl.report.map_content import MapContent, map_contents
from ensemble_ctrl.report.palette import hexadecimal, shades, viridis
from ensemble_ctrl.report.text import conflict_text, member_text, summary_rows, unit_of, verdict
from ensemble_ctrl.report.transform import conflict_places, some
from ensemble_ctrl.report.tube import Ribbon, tubes

Floats = NDArray[np.float64]
Data = dict[str, Any]
MEMBERS = 15
"""Members drawn."""
FRAMES = 240
"""Times between which the page interpolates, at most."""
DIGITS = 4
"""Decimal places of a metre in a drawing."""


def drawing(plan: Plan) -> Data:
    """What the page shows of a plan.

    Returns
    -------
    dict
        Strict JSON data: the verdict in words with its class, the summary's rows, ``views`` with the ways of members
        and the tube in metres at ``times`` in seconds, and ``cards`` as HTML in which every text is escaped.
    """
    problem, controls = plan.problem, plan.controls
    members = problem.fleet.spread(MEMBERS if problem.fleet.names else 1)
    paths, members = all_paths(problem, controls, members, 2)
    times = np.linspace(0.0, problem.duration, paths.shape[1])
    keep = some(len(times), FRAMES)
    ribbons, marks = tubes(problem, controls), conflict_places(plan)
    counter = _counter(plan)
    views = [
        {
            "ways": _rounded(content.paths[:, keep]),
            "tube": [_ribbon(one) for one in ribbons.get(content.view, ())],
            "marks": [
                {"at": _rounded(content.at(place, conflict.time)), "text": conflict_text(conflict)}
                for conflict, place in marks
            ],
            "counter": None if counter is None else _seen(counter, content),
            **surroundings(content, times[keep]),
        }
        for content in map_contents(problem, paths)
    ]
    return {
        "status": plan.status,
        "verdict": verdict(plan),
        "class": verdict_class(plan),
        "proven": plan.certificate is not None and plan.certificate.proven == "yes" and plan.verified,
        "rows": summary_rows(plan),
        "duration": problem.duration,
        "times": times[keep].round(4).tolist(),
        "colours": [hexadecimal(colour) for colour in viridis(shades(problem.fleet, members))],
        "members": [member_text(dict(zip(problem.fleet.names, row, strict=True))) for row in members.tolist()],
        "scale": _scale(plan),
        "radius": problem.fleet.radius,
        "views": views,
        "cards": cards(plan),
    }


def _counter(plan: Plan) -> tuple[CounterExample, Floats] | None:
    """The member that the certificate found to violate the task, with its way, shape (times, d)."""
    found = None if plan.certificate is None else plan.certificate.counter_example
    if found is None or not found.parameters:
        return None
    # of several names that fit the longest, as of "cid" and "b from start cid"
    whose = [(name, one) for name, one in by_start(plan.problem).items() if found.what.endswith(label("", name))]
    if not whose:  # robots of two starts that come too close to each other
        return None
    _, problem = max(whose, key=lambda pair: len(pair[0]))
    return found, trajectories(problem, plan.controls, problem.fleet.members([found.parameters]), 4)[0]


def _seen(counter: tuple[CounterExample, Floats], content: MapContent) -> Data:
    """The counter-example in one view: its way, and where it violates an obstacle."""
    found, way = counter
    times = np.linspace(0.0, content.problem.duration, len(way))
    text = f"{found.what}: {member_text(found.parameters)} violates it by {found.amount:.3g} m"
    place = None
    if found.time is not None:
        there = np.array([np.interp(found.time, times, column) for column in way.T])
        place = _rounded(content.at(there, found.time))
    points = np.array([content.at(point, time) for point, time in zip(way, times, strict=True)])
    return {"way": _rounded(points[some(len(times), FRAMES)]), "at": place, "text": text}


def _ribbon(ribbon: Ribbon) -> Data:
    """One slice of the tube."""
    return {
        "colour": hexadecimal(viridis(ribbon.share)),
        "rings": [_rounded(outline) for outline in ribbon.outlines],
    }


def surroundings(content: MapContent, times: Floats) -> Data:
    """One view without the fleet: its axes, and what stands and moves in it.

    Parameters
    ----------
    content : MapContent
    times : ndarray, shape (times,)
        At which moving obstacles are drawn, seconds.
    """
    return {
        "axes": content.labels,
        "hidden": content.hidden,
        "coordinates": content.view,
        "areas": [
            *({"kind": "region", "name": n, "corners": _rounded(c)} for n, c in content.regions.items()),
            *(
                {"kind": "obstacle", "name": shape.name, "corners": _rounded(corners)}
                for shape in content.obstacles
                for corners in shape.pieces
            ),
            *(
                {"kind": "patch", "name": patch.name, "corners": _rounded(corners)}
                for patch in content.patches
                for corners in patch.pieces
            ),
        ],
        "starts": [_rounded(place) for place in content.starts.values()],
        "target": None if content.target is None else _rounded(content.target),
        "moving": {s.name: _rounded(s.motion.at(times)) for s in content.obstacles if s.motion is not None},
    }


def _scale(plan: Plan) -> Data | None:
    """Which colour is which value of the first parameter."""
    fleet = plan.problem.fleet
    if not fleet.names or fleet.upper[0] <= fleet.lower[0]:
        return None
    ends = [f"{end:.4g}{unit_of(fleet.names[0])}" for end in (fleet.lower[0], fleet.upper[0])]
    return {"name": fleet.names[0], "ends": ends, "stops": [hexadecimal(c) for c in viridis(np.linspace(0, 1, 9))]}


def _rounded(points: Floats) -> Any:
    """Places in few digits."""
    return np.asarray(points, dtype=float).round(DIGITS).tolist()
