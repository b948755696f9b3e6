"""What is given from Python: plain things are taken, others are refused at the call by "expected .., got ..".

The first table gives every public constructor and function things of wrong types; the second what is plain.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.problem.evaluation.sampled import replay

TASK = "F[3,4] in(goal) and G avoid(obstacles)"
WRONG: dict[str, Any] = {
    "None": None,
    "number": 3.5,
    "true": True,
    "text": "x",
    "bytes": b"x",
    "list": ["y"],
    "section": {"a": 1},
    "object": object(),
    "nan": float("nan"),
    "array": np.zeros((2, 3, 4)),
}


def fleet(**changes: Any) -> ec.Fleet:
    """A unicycle at the origin."""
    fields: dict[str, Any] = {
        "system": ec.Unicycle(),
        "parameters": {"traction": ec.Interval(0.9, 1.1)},
        "position": [0, 0],
        "heading": 0.0,
        "input_lower": [-2, -2],
        "input_upper": [2, 2],
    }
    return ec.Fleet(**{**fields, **changes})


def by_states(**changes: Any) -> ec.Fleet:
    """A double integrator at the origin."""
    return ec.Fleet(**{"system": ec.DoubleIntegrator(), "parameters": {}, "start": {}, **changes})


def problem(**changes: Any) -> ec.Problem:
    """A goal and an obstacle beside the way."""
    fields: dict[str, Any] = {
        "name": "plain",
        "fleet": fleet(),
        "duration": 4.0,
        "steps": 20,
        "task": TASK,
        "regions": {"goal": [[1, 2], [-0.5, 0.5]]},
        "obstacles": {"post": [[0.6, 0.9], [0.3, 0.6]]},
    }
    return ec.Problem(**{**fields, **changes})


def plan(**changes: Any) -> ec.Plan:
    """Standing still."""
    return ec.Plan(**{"problem": problem(), "controls": np.zeros((20, 2)), "status": "planned", **changes})


SOLVE = ("method", "guarantee", "time_limit", "seed", "margin", "routes", "max_iterations", "cells")
MADE: dict[str, tuple[Callable[..., Any], dict[str, str]]] = {
    "Problem": (
        problem,
        {name: "" for name in ("fleet", "duration", "steps", "task", "regions", "obstacles", "motions", "objective")}
        | {name: "" for name in ("solve", "verify", "report")}
        | {"name": "text", "order": "None", "least_duration": "None number", "ignore": "text list section"},
    ),
    "Fleet": (
        fleet,
        {name: "" for name in ("system", "parameters")}
        | {name: "None" for name in ("position", "input_lower", "input_upper")}
        | {"heading": "None number", "radius": "number", "samples": "None", "rate_bounds": "None"},
    ),
    "Fleet by states": (
        by_states,
        {"system": "", "parameters": "", "start": "None", "radius": "number"}
        | {name: "None" for name in ("input_lower", "input_upper", "rate_bounds")},
    ),
    "Objective": (
        ec.Objective,
        {name: "number" for name in ("robustness", "terminal", "smoothness", "effort")}
        | {"target": "None", "cvar": "None", "earliest": "None text"},
    ),
    "SolveOptions": (
        lambda **given: problem(solve=ec.SolveOptions(**given)),
        {name: "number" if name in ("time_limit", "margin") else "" for name in SOLVE},
    ),
    "VerifyOptions": (
        lambda **given: problem(verify=ec.VerifyOptions(**given)),
        {"members": "", "substeps": "", "certificate": "true"},
    ),
    "ReportOptions": (ec.ReportOptions, {"baseline": "true", "suggest": "true"}),
    "Risk": (lambda **given: ec.Risk(**{"of": "terminal", **given}), {"of": "", "level": "", "weight": "number"}),
    "Plan": (plan, {"problem": "", "controls": "", "status": "", "details": "section"}),
    "Formation": (
        lambda **given: ec.Formation(**{"parameter": "a", "values": [0, 1], "places": [[0, 0], [1, 1]], **given}),
        {"parameter": "text", "values": "", "places": ""},
    ),
    "MomentTarget": (ec.MomentTarget, {"moments": ""}),
    "SpreadTarget": (
        lambda **given: ec.SpreadTarget(**{"mean": [0, 0], "covariance": np.eye(2), **given}),
        {"mean": "", "covariance": ""},
    ),
    "Zone": (
        lambda **given: ec.Zone(**{"pieces": ec.Obstacle.box([[0, 1], [0, 1]]), "speed": 0.5, **given}),
        {"pieces": "", "speed": "None number"},
    ),
    "Patch": (
        lambda **given: ec.Patch(**{"pieces": [[0, 1], [0, 1]], "parameters": {"traction": (0.6, 0.8)}, **given}),
        {"pieces": "", "parameters": ""},
    ),
    "Pose": (
        lambda **given: ec.Pose(**{"position": [0, 0], "heading": 0.0, "within": 0.1, "turn": 0.1, **given}),
        {"position": "number true"} | {name: "number true" for name in ("heading", "within", "turn")},
    ),
    "Disc": (
        lambda **given: ec.Disc(**{"center": [0, 0], "radius": 1.0, **given}),
        {"center": "", "radius": "number"},
    ),
    "Obstacle": (
        lambda **given: ec.Obstacle(**{"A": np.eye(2), "b": np.zeros(2), **given}),
        {"A": "", "b": ""},
    ),
    "Polyhedron": (
        lambda **given: ec.Polyhedron(**{"A": np.eye(2), "lower": np.zeros(2), "upper": np.ones(2), **given}),
        {"A": "", "lower": "", "upper": ""},
    ),
    "Bicycle": (ec.Bicycle, {"wheelbase": "number"}),
    "Interval": (
        lambda **given: ec.Interval(**{"lower": 0.0, "upper": 9.0, **given}),
        {"lower": "number", "upper": "number"},
    ),
    "Samples": (ec.Samples, {"values": ""}),
    "Mixture": (lambda parts: ec.Mixture(parts), {"parts": ""}),
    "LegendreBasis": (ec.LegendreBasis, {"order": ""}),
}
"""Constructors, and of each argument what of `WRONG` is right for it."""
CALLED: dict[str, tuple[Callable[[Any], Any], str]] = {
    "plan": (ec.plan, "text"),
    "plan guess": (lambda wrong: ec.plan(problem(), guess=wrong), "None"),
    "plan progress": (lambda wrong: ec.plan(problem(), progress=wrong), "None"),
    "plan log": (lambda wrong: ec.plan(problem(), log=wrong), "None text"),
    "example": (ec.example, ""),
    "load": (ec.load, "text"),
    "load_text": (ec.load_text, "text"),
    "load_text overrides": (lambda wrong: ec.load_text("{}", overrides=wrong), "text list section"),
    "parse": (ec.parse, ""),
    "certify": (lambda wrong: ec.certify(wrong, np.zeros((20, 2))), ""),
    "certify controls": (lambda wrong: ec.certify(problem(), wrong), ""),
    "certify ranges": (lambda wrong: ec.certify(problem(), np.zeros((20, 2)), wrong), "None"),
    "replay": (lambda wrong: replay(wrong, np.zeros((20, 2))), ""),
    "replay controls": (lambda wrong: replay(problem(), wrong), ""),
    "compare": (ec.compare, ""),
    "widest": (ec.widest, ""),
    "channels": (ec.channels, ""),
    "sweep": (ec.sweep, "text list"),
    "plan_many": (lambda wrong: list(ec.plan_many([wrong])), "text"),
    "edit": (ec.edit, "text"),
    "edit page": (lambda wrong: ec.edit(problem(), page=wrong), "None"),
    "edit height": (lambda wrong: ec.edit(problem(), height=wrong), ""),
    "edit trust": (lambda wrong: ec.edit(problem(), trust=wrong), "true"),
    "Uncertainty": (ec.Uncertainty, "section"),
    "Receding": (ec.Receding, ""),
    "unconstrained": (ec.unconstrained, ""),
    "Plan.replay": (lambda wrong: plan().replay(wrong), "None"),
    "Plan.replay substeps": (lambda wrong: plan().replay(2, substeps=wrong), "None"),
    "Plan.load": (ec.Plan.load, "text"),
    "Plan.save": (lambda wrong: plan().save(wrong), "text"),
    "Plan.plot": (lambda wrong: plan().plot(wrong), ""),
    "Plan.export": (lambda wrong: plan().export(wrong), ""),
    "Plan.animate": (lambda wrong: plan().animate(wrong), "text"),
    "Plan.to_dataframe": (lambda wrong: plan().to_dataframe(wrong), ""),
    "Plan.suggest": (lambda wrong: plan().suggest(wrong), "number true nan"),
    "Obstacle.box": (ec.Obstacle.box, ""),
    "Obstacle.polygon": (ec.Obstacle.polygon, ""),
    "Polyhedron.box": (ec.Polyhedron.box, ""),
    "Polyhedron.polygon": (ec.Polyhedron.polygon, ""),
    "Solid.box": (ec.Solid.box, ""),
    "Solid.hull": (ec.Solid.hull, ""),
}
"""Functions by their first argument, or the one named, and what of `WRONG` is right for it, or refused as no file."""
TABLE = [
    pytest.param(lambda wrong, make=make, name=name: make(**{name: wrong}), right, id=f"{kind}.{name}")
    for kind, (make, names) in MADE.items()
    for name, right in names.items()
] + [pytest.param(call, right, id=name) for name, (call, right) in CALLED.items()]


@pytest.mark.parametrize(("call", "right"), TABLE)
def test_wrong_types_are_refused_at_the_call(call: Callable[[Any], Any], right: str) -> None:
    for name, wrong in WRONG.items():
        if name in right.split():
            continue
        with pytest.raises((ec.ProblemError, ec.ConfigError), match=r"(?s)expected .*got ") as refusal:
            call(wrong)
        assert len(str(refusal.value)) < 1500, name


def test_every_public_name_is_in_the_table() -> None:
    inside = {"TruncatedNormal", "Beta"}  # of the same reader of numbers as Interval
    plain = {
        "examples",
        "Unicycle",
        "DifferentialDrive",
        "DoubleIntegrator",
        "Mecanum",
        "SingleIntegrator",
        "Trailer",
        "Quadrotor",
        "OdeSystem",
    }
    results = {"Certificate", "Replay", "Solid", "__version__"} | {n for n in ec.__all__ if n.endswith("Error")}
    assert set(ec.__all__) - {*MADE, *CALLED} - inside - plain - results == set()


@pytest.mark.parametrize(
    "controls",
    [
        np.zeros((19, 2)),
        np.zeros((21, 2)),
        np.zeros((20, 2)) + 0.5j,
        np.ma.masked_less(np.full((20, 2), 0.1), 0.2),
        np.full((20, 2), np.nan),
    ],
    ids=["a row less", "a row more", "complex", "masked", "nan"],
)
def test_nothing_is_proven_of_commands_that_are_not_those_of_the_plan(controls: Any) -> None:
    with pytest.raises(ec.ProblemError, match=r"controls: expected .*got "):
        ec.certify(problem(), controls)


def test_what_is_plain_is_taken(tmp_path: Path) -> None:
    box = [[0.6, 0.9], [0.3, 0.6]]
    one, other = ec.Obstacle.box(box), ec.Polyhedron.polygon([[1.6, 0.3], [1.9, 0.3], [1.7, 0.6]])
    corners = {"post": 4, "roof": 3}
    both = problem(obstacles={"post": box, "roof": other})
    assert {name: len(pieces[0].vertices) for name, pieces in both.obstacles.items()} == corners
    assert problem(obstacles=one).obstacles == {"o1": (one,)}
    assert [*problem(obstacles=[one, other]).obstacles] == ["o1", "o2"]
    assert problem(obstacles={"post": [one, box]}).obstacles["post"][0] is one
    assert problem(obstacles={"post": one}).obstacles["post"] == (one,)
    assert problem(obstacles={}, task="F[3,4] in(goal)").obstacles == {}
    assert str(problem().task) == TASK
    assert np.array_equal(problem().regions["goal"].upper, [2, 0.5])
    assert problem(duration="4000 ms").duration == 4.0
    assert problem(duration=np.float64(4), steps=np.int64(20)).step == 0.2
    assert fleet(heading="90 deg", radius="5 cm").heading == pytest.approx(np.pi / 2)
    assert fleet(radius="5 cm").radius == 0.05
    texts: dict[str, Any] = {"time_limit": "1 min", "margin": "2 cm"}
    options = ec.SolveOptions(**texts)
    assert (options.time_limit, options.margin) == (60.0, 0.02)
    assert problem(ignore="post").ignore == ("post",)
    (tmp_path / "small.yaml").write_text("""
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 2 s, steps: 8}
task: F[1, 2] x >= 0.2
verify: {members: 10}
""")
    for path in (tmp_path / "small.yaml", str(tmp_path / "small.yaml")):
        assert ec.plan(path).verified


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration": "20 m"}, "duration: expected a time in s, ms, min or h, got '20 m', which is a length"),
        ({"fleet": None}, "fleet: expected a Fleet, got None"),
        ({"objective": {"effort": 1}}, r"objective: expected an Objective, got \{'effort': 1\} \(dict\)"),
        ({"regions": {"goal": [[1, 2, 3]]}}, r"regions\['goal'\]: expected a Polyhedron, a Disc, or a box"),
        ({"regions": {1: [[1, 2], [1, 2]]}}, r"regions: a name: expected text, got 1 \(int\)"),
        ({"obstacles": {"a": [1, 2]}}, r"obstacles\['a'\]\[0\]: expected an Obstacle, a Disc, a bounded"),
        ({"obstacles": ec.Polyhedron([[1.0, 0.0]], [0.0], [1.0])}, "obstacles: expected an Obstacle.*unbounded"),
        ({"task": "F in(gaol)"}, "did you mean 'goal'"),
    ],
)
def test_the_message_names_the_argument(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ec.ProblemError, match=words):
        problem(**changes)


def test_a_misspelt_name_of_the_package_is_guessed_at() -> None:
    with pytest.raises(AttributeError) as caught:
        ec.plann  # noqa: B018
    assert (caught.value.name, caught.value.obj) == ("plann", ec)  # what Python's guess is made of
