"""Footprints in problem files: what is read, refused and written, and a plan from the file to its pictures."""

import json
from copy import copy
from pathlib import Path

import numpy as np
import pytest

from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.fingerprint import fingerprint
from ensemble_ctrl.constraints.footprint import Footprint
from ensemble_ctrl.core.errors import ConfigError, UnsupportedError
from ensemble_ctrl.files.config import dump, load, load_text
from ensemble_ctrl.files.config.dump import to_data
from ensemble_ctrl.ocp.bodies import body_hyperplanes
from ensemble_ctrl.ocp.truncation import choose, occupied
from ensemble_ctrl.planning.online.findings import loop_findings
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import replay
from ensemble_ctrl.problem.plain import problem_of, proven_part
from ensemble_ctrl.report.animation import animate
from ensemble_ctrl.report.figures import write_figures
from tests.paths import ROOT

CAR = """
version: 1
name: truck
fleet:
  model: bicycle
  wheelbase: 2.7 m
  parameters: {traction: {range: [0.98, 1.02]}}
  start: {position: [0, 0], heading: 0 deg}
  input_bounds: {v: [0, 3], delta: [-35 deg, 35 deg]}
  footprint: {length: 4.6 m, width: 1.9 m, rear_overhang: 1 m}
horizon: {duration: 10 s, steps: 20}
moments: {order: auto}
regions: {goal: {box: [[16, 20], [-1, 3]]}, pond: {disc: {center: [3, -9], radius: 1}}}
obstacles:
  truck: {box: [[8, 11], [-5, 0.5]]}
  tree: {disc: {center: [9, 6], radius: 80 cm}}
task: "F[9, 10] in(goal) and G avoid(obstacles) and G not in(pond)"
objective: {robustness: 0.3, effort: 0.02}
"""
REFUSED = {
    "a start inside": ("box: [[8, 11], [-5, 0.5]]", "box: [[3, 11], [-5, 0]]", "overlaps obstacle 'truck' by 0.6 m"),
    "no room": (
        "truck: {box: [[8, 11], [-5, 0.5]]}",
        "w: [{box: [[8, 9], [-30, 0]]}, {box: [[8, 9], [1.5, 30]]}, {box: [[-9, 9], [30, 31]]}, "
        "{box: [[-9, 9], [-31, -30]]}, {box: [[-10, -9], [-31, 31]]}]",
        "open a gap wider than the robots, 1.9 m",
    ),
    "no length": ("length: 4.6 m, ", "", "fleet.footprint: expected length and width, or a polygon, got no length"),
    "both": ("length:", "polygon: [[0, 0], [1, 0], [0, 1]], length:", "or length and width, got polygon and length"),
    "overhang": ("rear_overhang: 1 m", "rear_overhang: 5 m", "footprint.rear_overhang: expected 0 to 4.6 m"),
    "not convex": (
        "{length: 4.6 m, width: 1.9 m, rear_overhang: 1 m}",
        "{polygon: [[0, 0], [2, 0], [0.5, 0.5], [0, 2]]}",
        "footprint.polygon: expected a convex polygon\n",
    ),
    "moment": ("objective:", "solve: {guarantee: moment}\nobjective:", "solve.guarantee: the guarantee moment is not"),
    "minlp": ("objective:", "solve: {method: minlp}\nobjective:", "solve.method: minlp is not for fleets with a foot"),
    "modal": (
        "order: auto",
        "order: 3, coordinates: modal",
        "moments.coordinates: modal is not for fleets",
    ),
    "risk": ("effort: 0.02}", "effort: 0.02, cvar: {of: clearance, level: 0.9, weight: 1}}", "objective.cvar: a risk"),
    "uncertainty": ("  footprint:", "  uncertainty: {disturbance: {x: 0.1}}\n  footprint:", "errors of the heading"),
    "within F": ("G avoid(obstacles)", "F[1, 2] avoid(obstacles)", "of its own, got F[1,2] avoid(obstacles)"),
    "a share": ("G avoid(obstacles)", "share(0.9, G avoid(obstacles))", "in a part G avoid(...) of its own"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_plan_can_do_is_refused_at_its_line(case: str) -> None:
    before, after, said = REFUSED[case]
    assert before in CAR
    with pytest.raises(ConfigError) as caught:
        load_text(CAR.replace(before, after))
    assert said in str(caught.value)


def test_systems_without_an_exact_flow_refuse_a_body() -> None:
    text = (ROOT / "configs/systems/moving_points.yaml").read_text(encoding="utf-8")
    with pytest.raises(ConfigError, match=r"fleet\.footprint: a footprint is not for the double_integrator"):
        load_text(text.replace("  radius: 10 cm", "  footprint: {length: 1, width: 1}"))


def test_a_loop_refuses_a_body() -> None:
    found = [one.message for one in loop_findings(load_text(CAR))]
    assert any("online replanning is not for fleets with a footprint" in message for message in found)


def test_a_body_survives_writing_and_is_in_the_fingerprint() -> None:
    problem, controls = load_text(CAR), np.zeros((20, 2))
    again, plain = load_text(dump(problem)), problem_of(proven_part(to_data(problem)))
    assert again.fleet.footprint is not None
    np.testing.assert_allclose(again.fleet.footprint.corners, [[-1, -0.95], [3.6, -0.95], [3.6, 0.95], [-1, 0.95]])
    smaller = problem.with_(fleet=problem.fleet.with_(footprint=Footprint.rectangle(4.5, 1.9, 1.0)))
    bare = problem.with_(fleet=problem.fleet.with_(footprint=None))
    prints = [fingerprint(one, controls, one.fleet.parameters) for one in (problem, again, plain, smaller, bare)]
    assert len(set(prints[:3])) == 1
    assert len(set(prints)) == 3


def test_what_is_not_proven_of_bodies_is_undecided_or_refused() -> None:
    problem = load_text(CAR)
    elsewhere = _unchecked(problem, "F[1, 2] avoid(tree)")
    found = certify(elsewhere, np.zeros((20, 2)))
    assert found.proven == "undecided"
    assert "part G avoid(...) of its own" in found.reason
    with pytest.raises(UnsupportedError, match="of its own"):
        replay(elsewhere, np.zeros((20, 2)), members=5)


def _unchecked(problem: Problem, task: str) -> Problem:
    """A problem with another task that nobody has checked with these bodies."""
    other = copy(problem.with_(fleet=problem.fleet.with_(footprint=None), task=task))
    object.__setattr__(other, "fleet", problem.fleet)
    return other


def test_lines_separate_all_corners_of_all_members() -> None:
    problem, rng = load_text(CAR), np.random.default_rng(0)
    controls = np.column_stack([rng.uniform(1, 2.5, 20), rng.uniform(-0.2, 0.2, 20)])
    truncation = choose(problem, controls)
    curve = occupied(problem, controls, truncation)
    avoid = problem.specification.avoid
    planes = body_hyperplanes(problem, curve, avoid, truncation.parts, np.inf)
    body, fleet = problem.fleet.footprint, problem.fleet
    assert body is not None
    states = fleet.full_states(controls, fleet.grid(21), problem.step)
    names = [one.name for one in avoid if one.footprint is not None] + ["pond"]
    by_name = {one.name: one for one in avoid}
    for side, name in enumerate(names):
        (piece,) = by_name[name].pieces
        if by_name[name].footprint is None:
            seen = piece.distance(states[..., :2])
        else:
            seen = body.distance(piece, states[..., :2], states[..., 2])
        ends = np.minimum(seen[:, :-1], seen[:, 1:]).min(axis=0)
        gap = planes.gap[side]
        # the line between the hull of all members' bodies and the obstacle: never more than the distance of one body
        assert (gap <= ends + 2e-4).all()
        assert (gap[ends > 0] >= ends[ends > 0] - 1.5).all()


def test_a_truck_is_passed_with_the_whole_body(tmp_path: Path) -> None:
    problem = load_text(CAR)
    found = plan(problem)
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert found.replayed is not None
    least = min(one.distance for one in found.replayed.clearances)
    proven = min(one.proven for one in found.certificate.clearances)
    assert proven <= least + 1e-9
    # bodies as polygons, at their full size, between the wheels and the truck
    bare = certify(problem.with_(fleet=problem.fleet.with_(footprint=None)), found.controls)
    assert min(one.proven for one in bare.clearances) > proven + 0.5
    names = write_figures(problem, found.controls, tmp_path)
    assert (tmp_path / names[0]).stat().st_size > 10_000
    film = animate(problem, found.controls, tmp_path / "film.gif", seconds=0.3)
    assert film.stat().st_size > 1000


def test_the_report_draws_bodies_and_the_tube_names_them() -> None:
    from ensemble_ctrl.files.export.tube import to_geojson
    from ensemble_ctrl.report.pagemap import map_and_motion

    problem = load_text(CAR)
    controls = np.tile([1.5, 0.05], (20, 1))
    svg, motion = map_and_motion(problem, controls, {})
    assert svg.count('class="member body"') == 15
    headings = np.array(json.loads(motion)["headings"]) / -10
    true = problem.fleet.full_states(controls, problem.fleet.spread(15), problem.step)[..., 2]
    np.testing.assert_allclose(headings[:, -1], np.degrees(true[:, -1]), atol=0.06)
    facts = to_geojson(problem, controls)["features"][0]["properties"]
    np.testing.assert_allclose(facts["footprint"]["polygon"], [[-1, -0.95], [3.6, -0.95], [3.6, 0.95], [-1, 0.95]])
    assert 'stroke="black"/><circle' in problem._repr_html_()
    assert "footprint 4.6 m by 1.9 m" in problem._repr_html_()


def test_bodies_of_members_that_start_apart_are_drawn_at_each_start(tmp_path: Path) -> None:
    text = CAR.replace("  footprint:", "  starts: {a: [0, 0], b: [-2, 0.5]}\n  footprint:")
    problem, controls = load_text(text), np.tile([1.5, 0.05], (20, 1))
    assert (tmp_path / write_figures(problem, controls, tmp_path)[0]).stat().st_size > 10_000
    found = certify(problem, controls)
    alone = certify(load_text(CAR), controls)
    assert min(one.proven for one in found.clearances) <= min(one.proven for one in alone.clearances) + 1e-9


@pytest.mark.slow
def test_the_delivery_yard_is_proven() -> None:
    pytest.importorskip("ompl")
    found = plan(load(ROOT / "configs/vehicles/delivery_yard.yaml"))
    assert found.certificate is not None
    assert found.certificate.proven == "yes"
    assert (found.controls[:, 0] < -0.1).any()
