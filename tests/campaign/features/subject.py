"""A case given to the package: its problem, and what the certificate says."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ensemble_ctrl.certificate import Certificate, certify
from ensemble_ctrl.constraints import Disc, Obstacle, Polyhedron
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.systems import ArcSystem, Bicycle, Unicycle

from ..subject import distribution_of
from . import world
from .geometry import is_disc
from .world import Featured, Shape


def obstacle_of(shape: Shape) -> Obstacle:
    """A polygon or a disc."""
    if is_disc(shape):
        x, y, radius = np.array(shape).tolist()
        return Disc([x, y], radius)
    return Obstacle.polygon(shape)


def _pieces(shapes: tuple[Shape, ...]) -> tuple[Obstacle, ...]:
    """Several of them."""
    return tuple(obstacle_of(shape) for shape in shapes)


def uncertainty_of(errors: world.Errors, controls: tuple[str, ...]) -> Uncertainty:
    """The bounds of errors of the model."""
    first, second = controls
    states = {"position": errors.place, "x": errors.x, "y": errors.y, "heading": errors.heading}
    return Uncertainty(
        disturbance={name: bound for name, bound in states.items() if bound},
        actuators={first: errors.first, second: errors.second},
        shares={first: errors.share, second: errors.share},
        varies=errors.varies,
        delay=errors.delay,
        jitter=errors.jitter,
        heading_hold=errors.hold,
    )


def problem_of(case: Featured) -> Problem:
    """The problem of a case, with input bounds that its controls keep."""
    base = case.base
    most = np.maximum(np.abs(np.array(base.controls)).max(axis=0), 1e-3) * 2
    axis: Literal["x", "y"] = "y" if base.heading_from == "y" else "x"
    system: ArcSystem = Unicycle(axis)
    if base.system == "bicycle":
        system, most[1] = Bicycle(axis, base.wheelbase), 1.0
    fleet = Fleet(
        system,
        {name: distribution_of(one) for name, one in base.parameters.items()},
        np.array(base.position),
        base.heading,
        -most,
        most,
        radius=base.radius,
        uncertainty=uncertainty_of(case.errors, system.controls),
        starts=case.starts or None,
        footprint=Footprint(np.array(case.footprint)) if case.footprint else None,
    )
    return Problem(
        "case",
        fleet,
        base.duration,
        len(base.controls),
        parse(world.text(base.task)),
        {name: Polyhedron.box(box) for name, box in base.regions.items()},
        {name: _pieces(p) for name, p in base.obstacles.items()}
        | {name: _pieces((d,)) for name, d in case.discs.items()},
        {name: Motion(np.array(times), np.array(places)) for name, (times, places) in base.motions.items()},
        zones={name: Zone(_pieces(zone.shapes), zone.speed) for name, zone in case.zones.items()},
        terrain={name: Patch(_pieces(patch.shapes), patch.ranges) for name, patch in case.terrain.items()},
    )


def certified(case: Featured) -> Certificate:
    """What is proven of a case's controls."""
    return certify(problem_of(case), np.array(case.base.controls), each=True)
