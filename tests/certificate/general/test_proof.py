"""Certificates of systems that an ODE defines: against those of arcs, and against members that SciPy integrates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import claim
from ensemble_ctrl.certificate.general.proof import GeneralProof
from ensemble_ctrl.constraints import Obstacle, Solid
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.systems.arrays import cos, sin
from tests.paths import CONFIGS

Floats = NDArray[np.float64]


class Robot(ec.OdeSystem):
    """A unicycle by its equations."""

    name, states, positions = "robot", ("x", "y", "heading"), ("x", "y")
    controls, control_units, input_bounds = ("v", "omega"), ("m/s", "rad/s"), ((-1.0, 1.0), (-2.0, 2.0))
    parameters: ClassVar[Mapping[str, float]] = {"traction": 1.0}  # type: ignore[misc]

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
        v, omega = u
        return [psi["traction"] * v * cos(x[2]), psi["traction"] * v * sin(x[2]), psi["traction"] * omega]


def twin(problem: ec.Problem) -> ec.Problem:
    """The same problem of robots that are given by their equations."""
    fleet = problem.fleet
    start = {"x": fleet.position[0], "y": fleet.position[1], "heading": fleet.heading}
    robots = ec.Fleet(Robot(), dict(fleet.parameters), start=start, radius=fleet.radius)
    return ec.Problem("twin", robots, problem.duration, problem.steps, problem.task, problem.regions, problem.obstacles)


@pytest.mark.parametrize("name", ["five_obstacles", "three_obstacles"])
def test_both_enclosures_hold_each_other(name: str) -> None:
    """Of arcs and by the equations, nobody's proof is above what the other has seen, and both say the same."""
    problem = ec.load(CONFIGS / f"{name}.yaml")
    rng = np.random.default_rng(len(name))
    t = np.linspace(0, 1, problem.steps)
    controls = np.column_stack([0.4 + 0.2 * np.sin(5 * t + rng.random()), 0.3 * np.cos(7 * t + rng.random())])
    arcs, general = (ec.certify(one, controls, each=True) for one in (problem, twin(problem)))
    assert general.reason == ""
    assert len(arcs.clearances) == len(general.clearances) > 0
    pairs = [(b.proven, b.sampled) for b in arcs.clearances] + [(b.proven, b.sampled) for b in arcs.parts]
    others = [(b.proven, b.sampled) for b in general.clearances] + [(b.proven, b.sampled) for b in general.parts]
    for (proven, sampled), (proven_too, sampled_too) in zip(pairs, others, strict=True):
        assert proven <= sampled_too + 1e-9
        assert proven_too <= sampled + 1e-9
    for one, other in zip(arcs.clearances, general.clearances, strict=True):
        assert one.proven == pytest.approx(other.proven, abs=2e-3)
    assert arcs.proven == general.proven


def test_obstacles_that_move() -> None:
    """The bounds of both enclosures from obstacles on their way hold each other, too."""
    problem = ec.load(CONFIGS / "moving" / "crossing.yaml")
    t = np.linspace(0, 1, problem.steps)
    controls = np.column_stack([0.4 + 0.2 * np.sin(5 * t), 0.3 * np.cos(7 * t)])
    arcs = ec.certify(problem, controls)
    general = GeneralProof(twin(problem), controls, problem.fleet.parameters)
    moving = [avoid for avoid in problem.specification.avoid if avoid.motion is not None]
    assert moving
    for avoid in moving:
        one, other = next(b for b in arcs.clearances if b.obstacle == avoid.name), general.clearance(avoid)
        assert one.proven <= other.sampled + 1e-9
        assert other.proven <= one.sampled + 1e-9
        assert one.proven == pytest.approx(other.proven, abs=2e-3)


def masses(task: str, spread: float = 0.2, **more: Any) -> ec.Problem:
    """Point masses of unequal mass and start."""
    distributions = {"mass": ec.Interval(1 - spread, 1 + spread), "start_vy": ec.Interval(-0.05, 0.05)}
    fleet = ec.Fleet(ec.DoubleIntegrator(), distributions, radius=0.1)
    obstacles = {"post": (Obstacle.polygon([[1.5, 0.4], [2.0, 0.3], [2.2, 0.9], [1.7, 1.1]]),)}
    regions = {"goal": ec.Polyhedron.box([[1.8, 3.2], [-0.8, 0.8]])}
    return ec.Problem("masses", fleet, 3.0, 15, ec.parse(task), regions, obstacles, **more)


TASKS = [
    "G avoid(post) and F[2.5, 3] in(goal)",
    "G[0.33, 2.71] avoid(post) and G[2.9, 3] (vx <= 0.9 and vx >= 0.3)",
    "(vx <= 0.7) U[0, 2] (x >= 0.5) and G not (x >= 1 and x <= 1.2 and y >= 0.5)",
    "F[0, 1] G[0, 1.5] (x >= 0.2 or y <= -0.3)",
    "G[3, 3] x >= 1.7",
]


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("push", [0.35, 0.5, 0.62])
def test_a_yes_holds_for_members_and_a_no_is_one(task: str, push: float) -> None:
    """Against a replay on a fine grid: no bound above the worst member, little in between, counter-examples violate."""
    problem = masses(task)
    controls = np.column_stack([np.full(15, push), 0.05 * np.sin(np.arange(15))])
    found = ec.certify(problem, controls)
    fine = replace(problem, steps=600)
    run = replay(fine, np.repeat(controls, 40, axis=0), parameters=problem.fleet.grid(300), substeps=1)
    seen = min([c.distance for c in run.clearances] + [run.worst[0]])
    bound = min(found.clearance, found.robustness)
    assert bound <= seen + 5e-3  # what a value may change by between the times of the fine grid
    assert bound >= seen - 2e-2 or found.proven == "no"
    if abs(seen) > 2e-2:
        assert (found.proven == "yes") == (seen > 0)
    if found.counter_example is not None and found.counter_example.amount > 5e-3:
        member = np.array([list(found.counter_example.parameters.values())])
        assert replay(fine, np.repeat(controls, 40, axis=0), parameters=member).violating.all()


@pytest.mark.parametrize(("task", "verdict"), [
    ("share(0.5, F[2.9, 3] x >= 2.2)", "yes"), ("share(0.9, F[2.9, 3] x >= 2.5)", "no"),
    ("mean(F[2.9, 3] x >= 2.2)", "yes"), ("mean(G[0, 3] x <= 1)", "no"),
    ("mean(F[2.9, 3] x >= 9) or G[2.9, 3] x >= 2", "no"), ("mean(F[2.9, 3] x >= 9) or G[2.9, 3] x >= 1.7", "yes"),
])  # fmt: skip
def test_shares_and_means(task: str, verdict: str) -> None:
    """With x = 0.25 t^2 / mass at 3 s from 1.9 to 2.8: a half of the fleet is beyond 2.25, all beyond 1.75 at 2.9 s."""
    found = ec.certify(masses(task), np.full((15, 2), [0.5, 0.0]))
    assert found.proven == verdict
    if "x >= 1.7" in task:
        assert found.robustness <= 0.25 * 2.9**2 / 1.2 - 1.7


@pytest.mark.parametrize(("task", "unit"), [
    ("G x >= -1", "m"), ("G vx <= 2", "m/s"), ("G (vx <= 2 and x >= -1)", "in mixed units (m, m/s)"),
])  # fmt: skip
def test_a_robustness_of_other_units_says_so(task: str, unit: str) -> None:
    """In the bound, in what is written of it, and in what is printed."""
    found = ec.certify(masses(task), np.full((15, 2), [0.5, 0.0]))
    assert found.unit == unit
    assert f" {unit}, " in repr(found)
    assert [part["unit"] for part in claim(found)["parts"]] == ["" if unit == "m" else unit]


def test_solids_in_space() -> None:
    """A falling quadrotor is as far from a ledge as its height says, to the tolerance of the search."""
    fleet = ec.Fleet(ec.Quadrotor(), {"payload": ec.Interval(0.0, 0.3)}, start={"z": 3.0}, radius=0.2)
    ledge = Solid.hull(np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 1]], dtype=float))
    problem = ec.Problem("fall", fleet, 0.5, 10, ec.parse("G avoid(ledge)"), {}, {"ledge": (ledge,)})
    found = ec.certify(problem, np.tile([30.0, 0, 0, 0], (10, 1)))
    lowest = 3.0 + (30.0 / 4.0 - 9.81) * 0.125
    heaviest = 3.0 + (30.0 / 4.3 - 9.81) * 0.125
    assert lowest > heaviest
    assert found.clearance == pytest.approx(heaviest - 1.0 - 0.2, abs=1e-3)
    assert found.clearance <= heaviest - 1.2
    assert ec.certify(problem, np.tile([0.0, 0, 0, 0], (10, 1))).clearance < found.clearance


def test_a_narrower_range_is_proven_where_the_whole_is_not() -> None:
    """Ranges of a certificate are those that were asked about."""
    problem = masses("G[2.9, 3] x >= 2")
    controls = np.full((15, 2), [0.5, 0.0])
    assert ec.certify(problem, controls).proven == "no"
    assert ec.certify(problem, controls, {"mass": ec.Interval(0.9, 1.0)}).proven == "yes"


def test_what_can_not_be_enclosed_is_undecided_with_its_reason() -> None:
    """Nothing is claimed, and the reason names what grew, and when."""

    class Escaping(Robot):
        name = "escaping"

        def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> Sequence[Any]:
            return [x[0] ** 2 + u[0], 0.0 * x[1], 0.0 * x[2]]

    fleet = ec.Fleet(Escaping(), {"traction": ec.Interval(0.9, 1.1)}, start={"x": 1.0})
    problem = ec.Problem("escape", fleet, 2.0, 10, ec.parse("G x >= -1"))
    found = ec.certify(problem, np.zeros((10, 2)))
    assert (found.proven, found.parts, found.clearances) == ("undecided", (), ())
    assert "x runs away" in found.reason
    assert "t = " in found.reason
    calm = replace(problem, duration=0.5)
    assert ec.certify(calm, np.zeros((10, 2))).proven == "yes"


@pytest.mark.parametrize(("push", "proven"), [(0.0, "undecided"), (1.0, "no")])
def test_a_share_is_not_refuted_by_the_sharp_corner_of_a_grown_obstacle(push: float, proven: str) -> None:
    """Robots 0.113 m from a corner, with a radius of 0.1 m that reaches the lines of both sides."""
    where = {"x": -0.08, "y": -0.08}
    fleet = ec.Fleet(ec.DoubleIntegrator(), {"mass": ec.Interval(0.9, 1.1)}, start=where, radius=0.1)
    obstacles = {"o": (ec.Obstacle.box([[0.0, 1.0], [0.0, 1.0]]),)}
    problem = ec.Problem("corner", fleet, 1.0, 4, ec.parse("share(0.9, G avoid(o))"), obstacles=obstacles)
    controls = np.full((4, 2), push)
    assert ec.certify(problem, controls).proven == proven
    assert replay(problem, controls, members=50).satisfied == (proven != "no")
