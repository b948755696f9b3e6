"""Members that move off together from several places: planned in one frame, proven and replayed for each start."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.api.planning import with_suggestions
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate.__main__ import main as prove_again
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.constraints.stl import ExactOps, StateSignals, member_robustness, parse
from ensemble_ctrl.core.errors import ConfigError, ProblemError, UnsupportedError
from ensemble_ctrl.files.config import dump
from ensemble_ctrl.planning.planner import _of_all_starts, solve
from ensemble_ctrl.planning.planner.one_frame import in_one_frame
from ensemble_ctrl.problem.evaluation.sampled import headings, states
from ensemble_ctrl.problem.starts import by_start
from ensemble_ctrl.report.text import summary_lines
from tests.paths import ROOT

Floats = NDArray[np.float64]

TEXT = """\
fleet:
  model: unicycle
  parameters: {traction: {range: [0.9, 1.1]}}
  start: {position: [1, 0], heading: 30 deg}
  starts:
    ann: [0, 0]
    bob: [-1.5, 50 cm]
  radius: 0.1
horizon: {duration: 4 s, steps: 20}
regions: {goal: {box: [[1.5, 5.5], [-1, 3]]}, door: {disc: {center: [2, 1], radius: 0.8}}}
obstacles: {post: {box: [[2.2, 2.4], [-1, 0.1]]}, tree: {disc: {center: [0, 1.5], radius: 0.3}}}
motions: {post: {velocity: [0, -0.1]}}
task: "G avoid(obstacles) and G[3.5, 4] in(goal)"
objective: {terminal: {target: [3, 1], weight: 1}}
verify: {members: 40}
"""
MASS = """\
fleet:
  model: double_integrator
  parameters: {mass: {range: [0.95, 1.05]}}
  start: {position: [0, 0]}
  starts: [[0, 0], [0, 0.6]]
horizon: {duration: 4 s, steps: 16}
regions: {goal: {box: [[1.5, 2.5], [-0.5, 1.2]]}}
obstacles: {post: {box: [[0.9, 1.1], [-2, -0.2]]}}
task: "F[3, 4] in(goal) and G avoid(post) and G[3, 4] (vx <= 1)"
verify: {members: 40}
"""


BOB = "bob: [-1.5, 50 cm]"
STARTS = f"starts:\n    ann: [0, 0]\n    {BOB}"


def drive(seed: int, steps: int = 20) -> Floats:
    """Commands of a drive forwards, with turns."""
    generator = np.random.default_rng(seed)
    return np.column_stack([generator.uniform(0.3, 0.9, steps), generator.uniform(-0.8, 0.8, steps)])


def by_hand(controls: Floats, start: Floats, heading: float, traction: float, step: float, fine: int = 50) -> Floats:
    """Positions of a unicycle by many short chords, at the ends of `fine` parts of each step."""
    place, places = np.array(start, dtype=float), [np.array(start, dtype=float)]
    for v, omega in controls:
        for _ in range(fine):
            dt = step / fine
            middle = heading + traction * omega * dt / 2
            place = place + traction * v * dt * np.array([np.cos(middle), np.sin(middle)])
            heading += traction * omega * dt
            places.append(place)
    return np.array(places)


@pytest.mark.parametrize("seed", range(3))
def test_bounds_are_below_what_shapely_measures_for_members_of_every_start(seed: int) -> None:
    problem = ec.load_text(TEXT.replace("motions: {post: {velocity: [0, -0.1]}}\n", ""))
    controls, tree = drive(seed), shapely.Point(0, 1.5).buffer(0.3, 256)
    certificate = certify(problem, controls, each=True)
    seen: dict[str, float] = {}
    for name, offset in {"ann": [0.0, 0.0], "bob": [-1.5, 0.5]}.items():
        for traction in np.linspace(0.9, 1.1, 41):
            way = shapely.points(by_hand(controls, np.array([1.0, 0.0]) + offset, np.pi / 6, traction, 0.2, 10))
            for what, shape in (("post", shapely.box(2.2, -1, 2.4, 0.1)), ("tree", tree)):
                key = f"{what} from start {name}"
                inside = shapely.contains(shape, way).any()
                here = -0.1 if inside else float(shapely.distance(way, shape).min()) - 0.1
                seen[key] = min(seen.get(key, np.inf), here)
    assert {bound.obstacle for bound in certificate.clearances} == set(seen)
    for bound in certificate.clearances:
        if seen[bound.obstacle] > -0.1:
            assert bound.proven <= seen[bound.obstacle] + 1e-6
            assert bound.proven == pytest.approx(seen[bound.obstacle], abs=0.02)


def test_one_start_that_fails_refutes_the_plan_and_is_named() -> None:
    problem = ec.load_text(TEXT)
    straight = np.tile([0.7, 0.0], (20, 1))
    certificate = certify(problem, straight)
    alone = {name: certify(one, straight) for name, one in by_start(problem).items()}
    assert alone["ann"].proven == "yes"
    assert alone["bob"].proven == "no"
    assert certificate.proven == "no"
    assert certificate.counter_example is not None
    assert certificate.counter_example.what.endswith(" from start bob")
    assert certificate.robustness == min(one.robustness for one in alone.values())
    run = ec.replay(problem, straight, members=11, substeps=4)
    assert run.members == 12
    assert run.worst_start == "bob"
    assert {start for start, bad in zip(run.starts, run.violating, strict=True) if bad} == {"bob"}
    assert run.corners == 4


@pytest.mark.parametrize("text", [TEXT, MASS], ids=["arcs", "states"])
def test_the_task_in_one_frame_is_that_of_all_starts(text: str) -> None:
    """A member does the task on the copies of the map just as well as the worst of its likes at the starts."""
    more = "\n" + (
        'task: "(x <= 3 U[0, 3] in(door)) and F (2*x - y >= 1 and avoid(tree)) and G[1, 2] not in(door)"'
        if text is TEXT
        else 'task: "F[3, 4] in(goal) and G avoid(post) and G[1, 3] (in(goal) and y <= 2)"'
    )
    problem = ec.load_text("\n".join(line for line in text.splitlines() if not line.startswith("task:")) + more)
    controls = drive(5) if text is TEXT else np.random.default_rng(1).uniform(-1, 1, (16, 2))
    members = problem.fleet.grid(5)

    def worst(one: ec.Problem) -> Floats:
        signals = StateSignals(states(one, controls, members), one.fleet.states, one.step)
        parts = [part.formula for part in one.specification.parts]
        values = [member_robustness(part, signals, ExactOps())[:, 0] for part in parts]
        paths = (
            signals.states[..., one.fleet.place_columns]
            if hasattr(signals, "states")
            else states(one, controls, members)[..., one.fleet.place_columns]
        )
        values += [avoid.distances(paths, one.times).min(axis=1) for avoid in one.specification.avoid]
        return np.asarray(np.min(values, axis=0))

    each = np.min([worst(one) for one in by_start(problem).values()], axis=0)
    np.testing.assert_allclose(worst(in_one_frame(problem)), each, atol=1e-9)


@pytest.mark.parametrize("text", [TEXT, MASS], ids=["arcs", "states"])
def test_a_plan_is_proven_for_all_starts(text: str) -> None:
    problem = ec.load_text(text)
    plan = ec.plan(problem)
    assert plan.status == "planned"
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    for one in by_start(problem).values():
        assert certify(one, plan.controls).proven == "yes"
        assert not ec.replay(one, plan.controls, members=100, substeps=5).violating.any()
    again = ec.load_text(dump(problem))
    assert dict(again.fleet.starts) == dict(problem.fleet.starts)
    assert certify(again, plan.controls).inputs == plan.certificate.inputs


def test_the_proof_is_of_these_starts() -> None:
    problem, controls = ec.load_text(TEXT), drive(1)
    inputs = certify(problem, controls).inputs
    moved = ec.load_text(TEXT.replace(BOB, "bob: [-1.5, 50.1 cm]"))
    named = ec.load_text(TEXT.replace("bob:", "eve:"))
    one = ec.load_text(TEXT.replace("    bob: [-1.5, 50 cm]\n", ""))
    assert len({inputs, *(certify(other, controls).inputs for other in (moved, named, one))}) == 4


def test_a_run_writes_what_is_proven_again_without_the_package(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "two.yaml").write_text(TEXT, encoding="utf-8")
    folder = tmp_path / "plan"
    assert invoke([str(tmp_path / "two.yaml"), "-o", str(folder), "--quiet"]) == 0
    assert {"trajectories.png", "report.html"} <= {path.name for path in folder.iterdir()}
    text = capsys.readouterr().out
    assert "at 2 offsets (ann, bob)" in text
    assert " from start " in text
    assert prove_again([str(folder)]) == 0
    data = json.loads((folder / "proof_input.json").read_text(encoding="utf-8"))
    data["problem"]["fleet"]["starts"]["bob"][0] -= 0.25
    (folder / "proof_input.json").write_text(json.dumps(data), encoding="utf-8")
    assert prove_again([str(folder)]) == 4


def test_what_is_for_one_start_is_refused() -> None:
    with pytest.raises(ec.UnsupportedError, match=r"^this is for one start, and fleet.starts has several: ann, bob;"):
        _ = ec.load_text(TEXT).fleet.position


def test_a_plan_that_falls_short_says_so_and_tries_no_changes() -> None:
    problem = ec.load_text(TEXT)
    short = ec.Plan(problem, np.tile([0.1, 0.0], (20, 1)), "infeasible", {})
    assert with_suggestions(short) is short
    assert {conflict.start for conflict in short.conflicts()} == {"ann", "bob"}
    assert "from start bob" in str(summary_lines(short))


def test_ten_kilobots_cannot_be_gathered() -> None:
    text = (ROOT / "configs/vehicles/kilobots_in_turn.yaml").read_text(encoding="utf-8")
    assert len(ec.load_text(text).fleet.starts) == 10
    with pytest.raises(ConfigError, match=r"the starts are 0\.24 m apart where it is 0\.12 m wide"):
        ec.load_text(text.replace("F in(nest)", "G[85, 90] in(nest)"))
    wide = text.replace("[0.30, 0.42]", "[0.30, 0.55]").replace("F in(nest)", "G[85, 90] in(nest)")
    assert ec.load_text(wide).regions


def test_starts_from_python() -> None:
    fleet = ec.Fleet(ec.Unicycle(), {}, [1, 2], 0.0, starts=[[0, 0], [1, 0]])
    assert dict(fleet.starts) == {"s1": (0.0, 0.0), "s2": (1.0, 0.0)}
    assert fleet.at_start("s2").position.tolist() == [2.0, 2.0]
    assert fleet.with_(radius=1.0).starts == fleet.starts
    assert not fleet.with_(starts=None).starts
    with pytest.raises(UnsupportedError, match=r"fleet\.starts has several: s1, s2"):
        _ = fleet.position
    with pytest.raises(ProblemError, match="start: expected one of s1, s2, got 'x'"):
        fleet.at_start("x")
    for starts, message in (
        ([[0, 0, 0]], r"fleet.starts.s1: expected a place \[x, y\], got \[0.0, 0.0, 0.0\]"),
        ({"a": [0, np.nan]}, "fleet.starts.a: expected a place"),
        ({"a": [0, 0], "b": [0, 0]}, "fleet.starts.b: expected another place than that of a"),
        ({"": [0, 0]}, "fleet.starts: expected names"),
        (np.zeros((101, 2)), "100 at most, got 101"),
    ):
        with pytest.raises(ProblemError, match=message):
            ec.Fleet(ec.Unicycle(), {}, [1, 2], 0.0, starts=starts)


def test_a_grid_and_a_list_in_a_file() -> None:
    grid = ec.load_text(TEXT.replace(STARTS, "starts: {grid: [2, 2], spacing: 30 cm}"))
    assert list(grid.fleet.starts) == ["s1", "s2", "s3", "s4"]
    assert list(grid.fleet.starts.values()) == [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3), (0.3, 0.3)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (BOB, "bob: [-1, 1.4]", r":7:\d+: error: fleet.starts.bob: the start .* inside obstacle 'tree'"),
        (BOB, "bob: [0, 0, 1]", r":7:\d+: error: fleet.starts.bob: expected \[x, y\], got \[0.*\]"),
        (BOB, "bob: [0, 0]", r":7:\d+: error: fleet.starts.bob: expected another place than that of ann"),
        (BOB, "bob: [0, 5 s]", r":7:\d+: error: fleet.starts.bob: expected a length"),
        (BOB, "bob: [-9, 0]", "13:7: error: task: no command brings all members into 'goal' at one time"),
        (STARTS, "starts: 7", "expected places by name, a list of them, or a grid"),
        (STARTS, "starts: {grid: [2, 0], spacing: 1 m}", "how many along x"),
        (STARTS, "starts: {grid: [2, 2]}", "expected grid and spacing"),
        ("verify:", "solve: {method: minlp}\nverify:", r"solve.method: this is for fleets with one start"),
        ("G[3.5, 4] in(goal)", "G[3.5, 4] mean(in(goal))", r"task: this is for fleets with one start"),
        ("duration: 4 s", "duration: {at_most: 4 s}", "horizon.duration: this is for fleets with one start"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_at_its_line(old: str, new: str, message: str) -> None:
    assert old in TEXT
    with pytest.raises(ConfigError, match=message):
        ec.load_text(TEXT.replace(old, new))


def test_a_system_whose_rates_depend_on_the_place_has_one_start() -> None:
    class Windy(ec.OdeSystem):
        name, states, positions = "windy", ("x",), ("x",)
        controls, control_units, input_bounds = ("u",), ("m/s",), ((-1.0, 1.0),)

        def xdot(self, x, u, psi):  # type: ignore[no-untyped-def]
            return [u[0] - 0.1 * x[0]]

    fleet = ec.Fleet(Windy(), {}, start={}, starts=[[0], [1]])
    with pytest.raises(ProblemError, match="the rates of the windy depend on the position"):
        ec.Problem(name="w", fleet=fleet, duration=1.0, steps=4, task=parse("F (x >= 0.5)"))


def test_bodies_are_drawn_at_every_start() -> None:
    body = "footprint: {length: 40 cm, width: 20 cm, rear_overhang: 10 cm}"
    problem = ec.load_text(TEXT.replace("radius: 0.1", body))
    plan = ec.Plan(problem, np.tile([0.75, 0.0], (20, 1)), "planned", {})
    figure = plan.plot("trajectories").figure
    assert figure is not None
    (axes, *_) = figure.axes
    (outlines,) = [one for one in axes.collections if isinstance(one, PolyCollection)]
    lefts = [np.asarray(path.vertices)[:, 0].min() for path in outlines.get_paths()]
    assert min(lefts) < -0.5 < 0.8 < np.median(lefts)
    heading = headings(problem, plan.controls, problem.fleet.corners)
    assert heading is not None
    np.testing.assert_allclose(heading, np.pi / 6)


def test_what_is_proven_is_a_plan_though_the_program_fell_short_of_it_by_its_own_measure() -> None:
    problem = ec.load_text(TEXT)
    found = solve(problem)
    short = replace(found, problem=in_one_frame(problem), status="infeasible")
    assert _of_all_starts(problem, short, lambda margin, controls: short).status == "planned"
    off = replace(short, controls=np.zeros((20, 2)))
    assert _of_all_starts(problem, off, lambda margin, controls: off).status == "infeasible"
