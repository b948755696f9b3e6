"""From a `Problem` back to a problem file with every default filled in."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Disc, Obstacle, Polyhedron, Solid
from ensemble_ctrl.constraints.disc import disc_of
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import Predicate
from ensemble_ctrl.files.config.fleets import fleet_data
from ensemble_ctrl.files.config.targets import target_data
from ensemble_ctrl.files.config.tree import SCALARS
from ensemble_ctrl.files.config.uncertainty_section import uncertainty_data
from ensemble_ctrl.files.config.zones import zone_data
from ensemble_ctrl.problem import Objective, Problem
from ensemble_ctrl.problem.terrain import Patch

Floats = NDArray[np.float64]
Data = dict[str, Any]
Places = tuple[str, ...]


def dump(problem: Problem) -> str:
    """A problem file that loads as the same problem, number for number.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    str
        YAML in SI units and radians, with every default and override filled in.

    Notes
    -----
    Obstacles are written as their convex pieces, and polygons by their corners where that is exact.
    """
    text: str = yaml.dump(
        to_data(problem),
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=None,
        width=110,
        allow_unicode=True,
    )
    return text


def to_data(problem: Problem) -> Data:
    """The same as plain data."""
    places = problem.fleet.places
    return {
        "version": 1,
        "name": problem.name,
        "fleet": fleet_data(problem.fleet),
        "horizon": {"duration": _duration(problem), "steps": int(problem.steps)},
        "moments": _moments(problem),
        "regions": {name: _region(region, places) for name, region in problem.regions.items()},
        "obstacles": {name: _obstacle(pieces, places) for name, pieces in problem.obstacles.items()},
        "motions": {name: _motion(motion) for name, motion in problem.motions.items()},
        "zones": _zones(problem),
        "terrain": {name: _patch(patch, places) for name, patch in problem.terrain.items()},
        "ignore": list(problem.ignore),
        "task": str(problem.task),
        "objective": _objective(problem.objective, problem.fleet.system.controls),
        "solve": asdict(problem.solve),
        "verify": asdict(problem.verify),
        "report": asdict(problem.report),
    }


def _zones(problem: Problem) -> Data:
    """Areas with their rules."""
    places = problem.fleet.places
    return {
        name: zone_data(zone, [_piece(piece, places) for piece in zone.pieces]) for name, zone in problem.zones.items()
    }


def _moments(problem: Problem) -> Data:
    """How the fleet is represented."""
    order = "auto" if problem.order is None else int(problem.order)
    return {
        "basis": "legendre",
        "order": order,
        "coordinates": problem.coordinates,
        "integrator": problem.integrator,
    }


def _duration(problem: Problem) -> float | Data:
    """The plan's duration, or its bounds."""
    if problem.least_duration is None:
        return float(problem.duration)
    return {"at_least": float(problem.least_duration), "at_most": float(problem.duration)}


def _motion(motion: Motion) -> Data:
    """A moving obstacle's path."""
    pairs = zip(motion.times.tolist(), motion.offsets.tolist(), strict=True)
    data: Data = {"path": [[time, offset] for time, offset in pairs]}
    if not motion.known:
        data["uncertainty"] = {"position": motion.uncertainty, "speed": motion.growth, "since": motion.since}
    return data


def _objective(objective: Objective, controls: tuple[str, ...]) -> Data:
    """The section on the objective."""
    effort: float | Data = dict(zip(controls, objective.efforts(len(controls)).tolist(), strict=True))
    if isinstance(objective.effort, int | float):
        effort = float(objective.effort)
    data: Data = {"robustness": float(objective.robustness), "effort": effort}
    if objective.cvar is not None:
        data["cvar"] = asdict(objective.cvar)
    if objective.smoothness:
        data["smoothness"] = float(objective.smoothness)
    if objective.earliest is not None:
        data["earliest"] = objective.earliest
    if objective.tolerance is not None:
        data["tolerance"] = uncertainty_data(objective.tolerance).get("uncertainty", {})
    if objective.target is not None:
        data["terminal"] = {"target": target_data(objective.target), "weight": float(objective.terminal)}
    return data


def _region(region: Polyhedron, places: Places) -> Data:
    """A region in the shortest form that is exact."""
    if (disc := disc_of(region)) is not None:
        return _disc(disc)
    if np.array_equal(region.A, np.eye(len(places))) and np.isfinite([region.lower, region.upper]).all():
        return {"box": np.column_stack([region.lower, region.upper]).tolist()}
    if np.isinf(region.upper).all() and np.isfinite(region.lower).all():
        corners = _corners_of(region) if len(places) == 2 else None
        if corners is not None:
            return {"polygon": corners.tolist()}
        return {"halfspaces": _inequalities(region.A, region.lower, places)}
    G, h = region.unit_rows()
    return {"halfspaces": _inequalities(-G, -h, places)}


def _obstacle(pieces: tuple[Obstacle, ...], places: Places) -> Data | list[Data]:
    """An obstacle's pieces."""
    written = [_piece(piece, places) for piece in pieces]
    return written[0] if len(written) == 1 else written


def _patch(patch: Patch, places: Places) -> Data:
    """A patch of terrain: its area, and the ranges in it."""
    shapes = [_piece(piece, places) for piece in patch.pieces]
    area: Data = shapes[0] if len(shapes) == 1 else {"areas": shapes}
    return area | {name: list(ends) for name, ends in patch.parameters.items()}


def _piece(piece: Obstacle, places: Places) -> Data:
    """One convex piece in the shortest form that is exact."""
    if (disc := disc_of(piece)) is not None:
        return _disc(disc)
    box = np.column_stack([piece.vertices.min(axis=0), piece.vertices.max(axis=0)])
    if _same((Solid if len(box) == 3 else Obstacle).box(box), piece.A, piece.b):
        return {"box": box.tolist()}
    if len(places) == 2 and _same(Obstacle.polygon(piece.vertices), piece.A, piece.b):
        return {"polygon": piece.vertices.tolist()}
    return {"halfspaces": _inequalities(piece.A, piece.b, places)}


def _disc(disc: Disc) -> Data:
    """A disc."""
    return {"disc": {"center": disc.center.tolist(), "radius": disc.radius}}


def _corners_of(region: Polyhedron) -> Floats | None:
    """The corners from which a polygon has exactly these rows, if there are any."""
    if region.is_empty or not region.is_bounded or len(region.vertices) < 3:
        return None
    made = Polyhedron.polygon(region.vertices)
    return region.vertices if np.array_equal(made.A, region.A) and np.array_equal(made.lower, region.lower) else None


def _same(obstacle: Obstacle, A: Floats, b: Floats) -> bool:
    """Whether an obstacle has exactly these rows."""
    return np.array_equal(obstacle.A, A) and np.array_equal(obstacle.b, b)


def _inequalities(A: Floats, b: Floats, places: Places) -> list[str]:
    """``A x >= b`` as texts."""
    rows = zip(A.tolist(), b.tolist(), strict=True)
    return [str(Predicate(tuple(zip(places, row, strict=True)), -bound)) for row, bound in rows]


class _Dumper(yaml.SafeDumper):
    """Floats with every digit, and quotes wherever some reader would not see a text."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write everything out."""
        return True


def _float(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    """The shortest text that reads back as the same number."""
    text = repr(value)
    return dumper.represent_scalar(
        "tag:yaml.org,2002:float", text if "inf" not in text else text.replace("inf", ".inf")
    )


_Dumper.add_representer(float, _float)
for _tag, _pattern in SCALARS:
    _Dumper.add_implicit_resolver(_tag, _pattern, None)
