"""From the plain data of a problem file to what a proof is about: with NumPy and the standard library alone.

`ensemble_ctrl.files.config` reads what people write, with units, defaults and messages. This reads only what
`ensemble_ctrl.files.config.dump` wrote, for `python -m ensemble_ctrl.certificate`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Disc, DiscRegion, Obstacle, Polyhedron, Solid
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import Predicate, parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.values import whole
from ensemble_ctrl.moments import DISTRIBUTIONS, Distribution, Mixture, Samples
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.problem import Problem
from ensemble_ctrl.problem.terrain import Patch
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.problem.zones import Zone
from ensemble_ctrl.systems import SYSTEMS, System

Floats = NDArray[np.float64]
Data = Mapping[str, Any]

SECTIONS = ("name", "fleet", "horizon", "regions", "obstacles", "motions", "zones", "terrain", "task")
"""What a proof is about; the rest of a problem says how to plan, and how to check."""
FLEET = (
    "model",
    "settings",
    "wheelbase",
    "parameters",
    "samples",
    "start",
    "input_bounds",
    "rate_bounds",
    "radius",
    "starts",
    "footprint",
    "uncertainty",
)
"""The keys of a fleet's section that are read here; one with others says more than is proven."""
FORMS = ("box", "polygon", "disc", "halfspaces")
"""The forms of a shape, each of which has exactly one."""


def proven_part(data: Data) -> dict[str, Any]:
    """The sections of a problem's data that a proof is about."""
    return {name: data[name] for name in SECTIONS if name in data}


def problem_of(data: Data) -> Problem:
    """A problem without objective and options.

    Parameters
    ----------
    data : mapping
        As `proven_part` gives it.

    Raises
    ------
    ProblemError
        If a section is not of the form that is written, or says more, or the model is a system of one's own.
    """
    try:
        _only("problem", data, SECTIONS)
        fleet = _fleet(data["fleet"])
        horizon, places = data["horizon"], fleet.places
        _only("horizon", horizon, ("duration", "steps"))
        return Problem(
            name=data["name"],
            fleet=fleet,
            duration=float(horizon["duration"]),
            steps=whole("horizon.steps", horizon["steps"], 1),
            task=parse(data["task"]),
            regions={name: _region(shape, places) for name, shape in data["regions"].items()},
            obstacles={name: _obstacle(shapes, places) for name, shapes in data["obstacles"].items()},
            motions={name: _motion(motion) for name, motion in data["motions"].items()},
            zones={name: _zone(zone, places) for name, zone in data.get("zones", {}).items()},
            terrain={name: _patch(patch, places) for name, patch in data.get("terrain", {}).items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, ProblemError):
            raise
        what = f"{type(error).__name__}: {error}"
        raise ProblemError(f"expected a problem as it is written beside a certificate, got another ({what})") from None


def _only(where: str, data: Data, keys: Collection[str]) -> None:
    """Refuse what would not be read: a reader of the file might take it for a part of the claim."""
    for name in data:
        if name not in keys:
            raise ProblemError(f"{where}: expected the keys {', '.join(keys)}, got {name!r}")


def _form(where: str, shape: Data, forms: Collection[str] = FORMS) -> None:
    """Refuse a shape that has not exactly one form."""
    if len(shape) != 1 or not shape.keys() <= set(forms):
        raise ProblemError(f"{where}: expected one of {', '.join(forms)}, got {', '.join(shape) or 'none'}")


def _fleet(data: Data) -> Fleet:
    """The fleet of either form of the section."""
    _only("fleet", data, FLEET)
    model = data["model"]
    if not isinstance(model, str) or model not in SYSTEMS:
        raise ProblemError(f"fleet.model: expected one of {', '.join(SYSTEMS)}, got {model!r}")
    kind = SYSTEMS[model]
    start, samples = dict(data["start"]), data.get("samples", {})
    settings = {name: data[name] for name in ("wheelbase",) if name in data} | dict(data.get("settings", {}))
    given: dict[str, Any] = {"start": start}
    if "heading_from" in start:
        settings["heading_from"] = start["heading_from"]
        given = _on_arcs(start)
    make: Callable[..., System] = kind
    system = make(**settings)
    bounds = np.array([_unbounded(*data["input_bounds"][name]) for name in system.controls])
    rates = [data.get("rate_bounds", {}).get(name, math.inf) for name in system.controls]
    columns = {name: np.array(column, dtype=float) for name, column in samples.items()}
    return Fleet(
        system,
        {name: _distribution(one) for name, one in data["parameters"].items()}
        | {name: Samples(column) for name, column in columns.items()},
        input_lower=bounds[:, 0],
        input_upper=bounds[:, 1],
        radius=float(data["radius"]),
        samples=columns or None,
        rate_bounds=np.array(rates) if "rate_bounds" in data else None,
        uncertainty=_uncertainty(data.get("uncertainty", {})),
        starts={name: np.array(place, dtype=float) for name, place in data.get("starts", {}).items()},
        footprint=_footprint(data["footprint"]) if "footprint" in data else None,
        **given,
    )


def _footprint(data: Data) -> Footprint:
    """The shape of a robot."""
    _only("fleet.footprint", data, ("polygon",))
    return Footprint(data["polygon"])


def _uncertainty(data: Data) -> Uncertainty:
    """Bounds of errors of the model; of commands, absolute ones and shares are written together."""
    bounds = dict(data)
    for name, pair in bounds.pop("actuators", {}).items():
        if set(pair) != {"absolute", "share"}:
            raise ProblemError(f"fleet.uncertainty.actuators.{name}: expected absolute and share, got {pair}")
        bounds.setdefault("actuators", {})[name] = pair["absolute"]
        bounds.setdefault("shares", {})[name] = pair["share"]
    return Uncertainty(**bounds)


def _unbounded(low: float | None, high: float | None) -> tuple[float, float]:
    """Bounds; JSON has null for what is infinite."""
    return -math.inf if low is None else low, math.inf if high is None else high


def _on_arcs(start: Data) -> dict[str, Any]:
    """Position and heading; the latter counts from +x, counter-clockwise."""
    _only("fleet.start", start, ("position", "heading", "heading_from"))
    own = float(start["heading"])
    heading = own if start["heading_from"] == "x" else math.pi / 2 - own
    return {"position": np.array(start["position"]), "heading": heading}


def _distribution(data: Data) -> Distribution:
    """One distribution, which has a weight in a mixture."""
    if "mixture" in data:
        _only("fleet.parameters", data, ("mixture", "weight"))
        return Mixture(*((_distribution(part), float(part["weight"])) for part in data["mixture"]))
    if "samples" in data:
        _only("fleet.parameters", data, ("samples", "weight"))
        return Samples(data["samples"])
    kind = DISTRIBUTIONS[data.get("distribution", "uniform")]
    _only("fleet.parameters", data, ("range", "distribution", "weight", "numbers", *kind.numbers))
    make: Callable[..., Distribution] = kind
    given = {**data, **data.get("numbers", {})}
    return make(*data["range"], *(given[name] for name in kind.numbers))


def _region(shape: Data, places: Sequence[str]) -> Polyhedron:
    """A region from its one form."""
    _form("regions", shape)
    if "disc" in shape:
        return DiscRegion(Disc(**shape["disc"]))
    if "box" in shape:
        return Polyhedron.box(shape["box"])
    if "polygon" in shape:
        return Polyhedron.polygon(np.array(shape["polygon"]))
    A, lower = _rows(shape["halfspaces"], places)
    return Polyhedron(A, lower, np.full(len(lower), np.inf))


def _obstacle(shapes: Data | Sequence[Data], places: Sequence[str]) -> tuple[Obstacle, ...]:
    """An obstacle's convex pieces."""
    listed = [shapes] if isinstance(shapes, Mapping) else shapes
    return tuple(_piece(shape, places) for shape in listed)


def _zone(data: Data, places: Sequence[str]) -> Zone:
    """A zone: its areas, and one rule."""
    shape = {name: value for name, value in data.items() if name not in ("v", "keep_out")}
    _form("zones", shape, (*FORMS, "areas"))
    if ("v" in data) == bool(data.get("keep_out")):
        raise ProblemError(f"zones: expected one of v and keep_out, got {sorted(data)}")
    return Zone(_obstacle(shape.get("areas", shape), places), float(data["v"]) if "v" in data else None)


def _piece(shape: Data, places: Sequence[str]) -> Obstacle:
    """One convex piece from its one form."""
    _form("a shape", shape)
    if "disc" in shape:
        return Disc(**shape["disc"])
    kind = Solid if len(places) == 3 else Obstacle
    if "box" in shape:
        return kind.box(shape["box"])
    if "polygon" in shape:
        return Obstacle.polygon(np.array(shape["polygon"]))
    return kind(*_rows(shape["halfspaces"], places))


def _patch(data: Data, places: Sequence[str]) -> Patch:
    """A patch of terrain: its area, one shape or several, and the range of each parameter."""
    shape = {name: value for name, value in data.items() if name in (*FORMS, "areas")}
    _form("terrain", shape, (*FORMS, "areas"))
    shapes = shape.get("areas", [shape])
    ranges = {name: tuple(ends) for name, ends in data.items() if name not in shape}
    return Patch(tuple(_piece(shape, places) for shape in shapes), ranges)


def _rows(texts: Sequence[str], places: Sequence[str]) -> tuple[Floats, Floats]:
    """Inequalities as ``A x >= b``."""
    parsed = [parse(text) for text in texts]
    halfspaces = [one for one in parsed if isinstance(one, Predicate)]
    if len(halfspaces) < len(parsed):
        raise ProblemError("expected inequalities in the coordinates")
    coefficients = [dict(one.coefficients) for one in halfspaces]
    for row in coefficients:
        _only("halfspaces", row, places)
    A = np.array([[row.get(state, 0.0) for state in places] for row in coefficients])
    return A, np.array([0.0 - one.offset for one in halfspaces])


def _motion(data: Data) -> Motion:
    """A displacement over time, and how well it is known."""
    _only("motions", data, ("path", "uncertainty"))
    times, offsets = zip(*data["path"], strict=True)
    known = data.get("uncertainty", {})
    _only("motions.uncertainty", known, ("position", "speed", "since"))
    loose = [float(known.get(name, 0.0)) for name in ("position", "speed", "since")]
    return Motion(np.array(times, dtype=float), np.array(offsets, dtype=float), *loose)
