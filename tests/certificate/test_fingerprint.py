"""A certificate is of one problem: every field that a proof depends on is in its fingerprint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.moments import Distribution, Mixture, Samples
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import Uncertainty

CONTROLS = np.full((4, 2), [0.5, 0.1])
FAR = {"position": 0.001}
BOX = Obstacle.box([[2, 3], [1, 2]])
FLEET: dict[str, Any] = {
    "system": ec.Unicycle(),
    "parameters": {"traction": ec.Interval(0.9, 1.1)},
    "position": [0.0, 0.0],
    "heading": 0.0,
    "radius": 0.1,
}
PROBLEM: dict[str, Any] = {
    "duration": 4.0,
    "task": "F[1, 3] in(goal) and G avoid(box)",
    "regions": {"goal": Polyhedron.box([[0, 9], [-9, 9]])},
    "obstacles": {"box": BOX},
    "motions": {"box": Motion(np.array([0.0, 4.0]), np.array([[0.0, 0.0], [1.0, 0.0]]))},
}
ROUND = Disc([2.0, 1.0], 0.5)
AROUND = Obstacle(ROUND.A, ROUND.b)
"""The polygon whose rows are those of the disc."""
WITHIN = DiscRegion(ROUND)
MUD = {"traction": (0.6, 0.8)}


def made(fleet: Mapping[str, Any], problem: Mapping[str, Any]) -> ec.Problem:
    """A problem with some arguments replaced."""
    of_fleet = {**FLEET, **fleet}
    given = {**PROBLEM, **problem}
    task = ec.parse(given.pop("task"))
    return ec.Problem("p", ec.Fleet(of_fleet.pop("system"), **of_fleet), steps=4, task=task, **given)


def printed(problem: ec.Problem, controls: Any = CONTROLS) -> str:
    """The fingerprint of a certificate of the fleet's own ranges."""
    return fingerprint(problem, controls, problem.fleet.parameters)


CHANGES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "as it is": ({}, {}),
    "system": ({"system": ec.Bicycle()}, {}),
    "wheelbase": ({"system": ec.Bicycle(wheelbase=0.6)}, {}),
    "axis": ({"system": ec.Unicycle("y")}, {}),
    "parameter": ({"parameters": {"linear_traction": ec.Interval(0.9, 1.1)}}, {}),
    "range": ({"parameters": {"traction": ec.Interval(0.9, np.nextafter(1.1, 2))}}, {}),
    "position": ({"position": [0.0, 5e-324]}, {}),
    "heading": ({"heading": 1e-12}, {}),
    "radius": ({"radius": 0.1 + 1e-12}, {}),
    "footprint": ({"footprint": Footprint.rectangle(1.0, 0.5)}, {}),
    "longer footprint": ({"footprint": Footprint.rectangle(1.0 + 1e-12, 0.5)}, {}),
    "disturbance": ({"uncertainty": Uncertainty(FAR)}, {}),
    "actuators": ({"uncertainty": Uncertainty(actuators={"v": 0.001})}, {}),
    "share of a command": ({"uncertainty": Uncertainty(shares={"v": 0.001})}, {}),
    "quantisation": ({"uncertainty": Uncertainty(quantisation={"v": 0.001})}, {}),
    "varies": ({"uncertainty": Uncertainty(varies={"traction": 0.001})}, {}),
    "delay": ({"uncertainty": Uncertainty(delay=0.001)}, {}),
    "jitter": ({"uncertainty": Uncertainty(jitter=0.001)}, {}),
    "heading_hold": ({"uncertainty": Uncertainty(FAR, heading_hold=1.0)}, {}),
    "starts": ({"starts": {"a": [0.0, 0.0], "b": [0.0, -3.0]}}, {}),
    "another start": ({"starts": {"a": [0.0, 0.0], "b": [0.0, -3.1]}}, {}),
    "duration": ({}, {"duration": 4.0 + 1e-9, "motions": {}}),
    "no motion": ({}, {"motions": {}}),
    "motion": ({}, {"motions": {"box": Motion(np.array([0.0, 4.0]), np.array([[0.0, 0.0], [1.0, 1e-12]]))}}),
    "window": ({}, {"task": "F[1, 3.0000000001] in(goal) and G avoid(box)"}),
    "region": ({}, {"regions": {"goal": Polyhedron.box([[0.0, 9.0], [-9.0, 9.1]])}}),
    "round region": ({}, {"regions": {"goal": WITHIN}}),
    "its polygon as a region": ({}, {"regions": {"goal": Polyhedron(WITHIN.A, WITHIN.lower, WITHIN.upper)}}),
    "obstacle": ({}, {"obstacles": {"box": Obstacle.box([[2.0, 3.0], [1.0, 2.1]])}}),
    "round obstacle": ({}, {"obstacles": {"box": ROUND}}),
    "its polygon as an obstacle": ({}, {"obstacles": {"box": AROUND}}),
    "zone": ({}, {"zones": {"z": ec.Zone((BOX,))}}),
    "limit": ({}, {"zones": {"z": ec.Zone((BOX,), 0.3)}}),
    "higher limit": ({}, {"zones": {"z": ec.Zone((BOX,), 0.3 + 1e-12)}}),
    "round zone": ({}, {"zones": {"z": ec.Zone((ROUND,))}}),
    "its polygon as a zone": ({}, {"zones": {"z": ec.Zone((AROUND,))}}),
    "terrain": ({}, {"terrain": {"mud": Patch((BOX,), MUD)}}),
    "round terrain": ({}, {"terrain": {"mud": Patch((ROUND,), MUD)}}),
    "its polygon as terrain": ({}, {"terrain": {"mud": Patch((AROUND,), MUD)}}),
    "ground": ({}, {"terrain": {"mud": Patch((BOX,), {"traction": (0.6, 0.8 + 1e-12)})}}),
    "ground of another parameter": ({}, {"terrain": {"mud": Patch((BOX,), {"linear_traction": (0.6, 0.8)})}}),
}


def test_every_field_has_a_fingerprint_of_its_own() -> None:
    found: dict[str, str] = {}
    for name, (fleet, problem) in CHANGES.items():
        same = found.setdefault(printed(made(fleet, problem)), name)
        assert same == name, f"{name} and {same} have one fingerprint"


def test_controls_and_ranges_are_in_it() -> None:
    problem = made({}, {})
    other = CONTROLS.copy()
    other[3, 1] = np.nextafter(0.1, 1)
    ranges = {"traction": ec.Interval(0.9, 1.2)}
    assert len({printed(problem), printed(problem, other), fingerprint(problem, CONTROLS, ranges)}) == 3


def spread(rows: int, moved: float) -> Samples:
    """Measured values of which one is moved, between those that are some of the quantiles."""
    values = np.linspace(0.9, 1.1, rows)
    values[rows // 2 + 3] += moved
    return Samples(values)


def mixed(weight: float) -> Mixture:
    """A mixture with a part that is less of the fleet than two quantiles are apart."""
    return Mixture((ec.Interval(0.9, 1.1), 1.0), (ec.Interval(1.001, 1.002), weight))


@pytest.mark.parametrize(
    "pair",
    [
        (spread(641, 0.0), spread(641, 1e-5)),
        (mixed(1e-4), mixed(2e-4)),
        (Mixture((spread(641, 0.0), 1.0)), Mixture((spread(641, 1e-5), 1.0))),
    ],
    ids=["measured", "mixed", "measured and mixed"],
)
def test_shares_are_of_one_distribution(pair: tuple[Distribution, Distribution]) -> None:
    task = {"task": "share(0.5, F[1, 3] in(goal))"}
    first, second = (printed(made({"parameters": {"traction": one}}, task)) for one in pair)
    assert first != second
