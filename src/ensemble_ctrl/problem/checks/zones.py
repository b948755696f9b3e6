"""What is wrong with zones: names, starts in what is kept out of, and limits that nothing here keeps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ensemble_ctrl.problem.checks.finding import SLACK, Finding
from ensemble_ctrl.problem.zones import SPEED

if TYPE_CHECKING:
    from ensemble_ctrl.problem.problem import Problem


def zone_findings(problem: Problem) -> Iterator[Finding]:
    """Everything wrong with the zones."""
    fleet = problem.fleet
    for name, zone in problem.zones.items():
        path = ("zones", name)
        if name in problem.regions or name in problem.obstacles:
            kind = "region" if name in problem.regions else "obstacle"
            yield Finding(path, f"expected a name of its own, got that of a {kind}", on_key=True)
        if odd := [piece for piece in zone.pieces if piece.A.shape[1] != len(fleet.places)]:
            wanted = f"expected {len(fleet.places)} dimensions ({', '.join(fleet.places)})"
            yield Finding(path, f"{wanted}, got {odd[0].A.shape[1]}", on_key=True)
            continue
        if zone.speed is not None:
            yield from _of_limits(problem, name)
            continue
        if fleet.footprint is not None and not fleet.footprint.holds_point:
            continue  # of bodies: `ensemble_ctrl.problem.checks.bodies`
        depth = fleet.radius - min(float(piece.distance(fleet.start_place)) for piece in zone.pieces)
        if depth > SLACK:
            place = ", ".join(f"{x:g}" for x in fleet.start_place)
            message = f"the start ({place}) is {depth:.3g} m deep inside zone {name!r}, which robots keep out of"
            yield Finding(("fleet", "start", "position"), message, "move the start or the zone")


def _of_limits(problem: Problem, name: str) -> Iterator[Finding]:
    """Problems in which a speed limit can't be kept for certain."""
    path, bounds = ("zones", name), problem.fleet.uncertainty
    if bounds.delay or bounds.jitter:
        message = "a speed limit can't be promised of robots whose commands may be late or early"
        yield Finding(path, message, "without delay and jitter in fleet.uncertainty")
    elif problem.solve.guarantee == "moment":
        yield Finding(("solve", "guarantee"), f"the moment form does not have the speed limit of {name}", "use hull")
    elif problem.coordinates == "modal":
        message = f"the program in moments does not have the speed limit of {name}"
        yield Finding(("moments", "coordinates"), message, "use nodal")
    zone, fleet = problem.zones[name], problem.fleet
    lowest = max(float(fleet.input_lower[0]), 0.0) if SPEED in fleet.system.controls else 0.0
    # the limit is on a member's own speed, of which the largest factor makes most
    if fleet.system.on_arcs:
        lowest *= float(fleet.coefficients(fleet.corners)[:, 0].max())
    depth = fleet.radius - min(float(piece.distance(fleet.start_place)) for piece in zone.pieces)
    if zone.speed is not None and lowest > zone.speed + SLACK and depth >= 0 and np.isfinite(depth):
        message = f"robots start in it and drive at least {lowest:g} m/s, faster than its limit of {zone.speed:g} m/s"
        yield Finding(path, message, "raise the limit or lower fleet.input_bounds.v", on_key=True)
