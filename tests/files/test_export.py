"""Plans as files for other programs, read back and compared with what was not made here."""

from __future__ import annotations

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import EnsembleError, ProblemError, UnsupportedError
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.files.config.geojson import shapes_of
from ensemble_ctrl.files.export.tube import areas
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.sampled import states, trajectories
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import OdeSystem, PlanarQuadrotor
from tests.report.plans import ode_made

Floats = NDArray[np.float64]

TEXT = """
name: out
fleet:
  model: MODEL
  parameters: PARAMETERS
  start: {position: [1, 2], heading: 30 deg, heading_from: AXIS}
horizon: {duration: 3 s, steps: 12}
task: G x >= -100
"""
FLEETS = {
    "one traction": ("unicycle", "{traction: {range: [0.8, 1.2]}}", "x"),
    "two tractions": ("unicycle", "{linear_traction: {range: [0.9, 1.1]}, angular_traction: {range: [0.7, 1.2]}}", "x"),
    "place and heading": ("unicycle", "{traction: {range: [0.9, 1.1]}, start_x: {range: [-0.2, 0.1]}, "
                          "start_heading: {range: [-10 deg, 10 deg]}}", "y"),
    "place alone": ("unicycle", "{start_x: {range: [-0.2, 0.1]}, start_y: {range: [0, 0.3]}}", "x"),
    "bicycle": ("bicycle", "{traction: {range: [0.9, 1.1]}}", "x"),
    "nothing": ("unicycle", "{traction: {range: [1, 1]}}", "x"),
}  # fmt: skip


def made(fleet: str, seed: int = 0) -> Plan:
    """A plan with random commands."""
    model, parameters, axis = FLEETS[fleet]
    text = TEXT.replace("MODEL", model).replace("PARAMETERS", parameters).replace("AXIS", axis)
    rng = np.random.default_rng(seed)
    controls = rng.uniform([-0.3, -0.5], [1.0, 0.5], (12, 2)) * ([1, 1] if model == "bicycle" else [1, 3])
    return Plan(load_text(text), controls, "planned")


# --- the tube


@pytest.mark.parametrize("fleet", FLEETS)
def test_every_member_is_in_the_tube_at_every_time_looked_at(fleet: str) -> None:
    for seed in range(2):
        plan = made(fleet, seed)
        members = np.concatenate([plan.problem.fleet.sample(150, seed), plan.problem.fleet.corners])
        paths = trajectories(plan.problem, plan.controls, members, substeps=7)
        for k, area in enumerate(areas(plan.problem, plan.controls)):
            during = paths[:, 7 * k : 7 * k + 8].reshape(-1, 2)
            shapely.prepare(area.outline)
            assert shapely.covers(area.outline, shapely.points(during)).all()


@pytest.mark.parametrize("fleet", ["one traction", "place alone", "bicycle"])
def test_the_tube_is_not_much_larger_than_the_fleet(fleet: str) -> None:
    plan = made(fleet)
    members = plan.problem.fleet.grid(400)
    paths = trajectories(plan.problem, plan.controls, members, substeps=8)
    for k, area in enumerate(areas(plan.problem, plan.controls)):
        during = shapely.MultiPoint(paths[:, 8 * k : 8 * k + 9].reshape(-1, 2)).convex_hull.buffer(0.02)
        assert area.outline.difference(during).area < 1e-9


def test_the_tube_as_geojson_has_a_feature_for_each_step_and_one_for_all(tmp_path: Path) -> None:
    plan = made("one traction")
    text = plan.export(tmp_path / "tube.geojson").read_text()
    (shapes, _), data = shapes_of(text), json.loads(text)
    assert {shape.name for shape in shapes} == {"fleet", *(f"step {k}" for k in range(12))}
    whole, *steps = (shapely.geometry.shape(feature["geometry"]) for feature in data["features"])
    assert whole.is_valid
    assert all(step.is_valid and whole.covers(step) for step in steps)
    assert data["features"][3]["properties"]["t_end"] == pytest.approx(0.75)
    assert data["features"][0]["properties"]["parameters"] == {"traction": [0.8, 1.2]}


@pytest.mark.parametrize("kind", ["plane", "space", "line"])
def test_members_of_other_systems_are_in_the_tube_between_its_heights(kind: str, tmp_path: Path) -> None:
    plan = ode_made(kind)
    fleet, count = plan.problem.fleet, len(plan.problem.fleet.places)
    paths = trajectories(plan.problem, plan.controls, np.concatenate([fleet.sample(100, 1), fleet.corners]), 7)
    data = json.loads(plan.export(tmp_path / "tube.geojson").read_text())
    whole, *steps = data["features"]
    assert whole["properties"]["axes"] == list(fleet.places[:2])
    assert len(steps) == plan.problem.steps
    for k, feature in enumerate(steps):
        during, facts = paths[:, 7 * k : 7 * k + 8].reshape(-1, count), feature["properties"]
        area = shapely.geometry.shape(feature["geometry"])
        flat = np.column_stack([during, np.zeros(len(during))]) if count == 1 else during[:, :2]
        near = shapely.MultiPoint(flat).convex_hull.buffer(0.02)
        assert shapely.covers(area, shapely.points(flat)).all()
        assert area.difference(near).area < 1e-9
        assert shapely.geometry.shape(whole["geometry"]).covers(area)
        if count == 3:
            assert facts["z_min"] <= during[:, 2].min() <= facts["z_min"] + 0.02
            assert facts["z_max"] - 0.02 <= during[:, 2].max() <= facts["z_max"]
            assert whole["properties"]["z_min"] <= facts["z_min"] < facts["z_max"] <= whole["properties"]["z_max"]
        else:
            assert not {"z_min", "z_max", "x_min", "y_min"} & set(facts)


def test_a_system_without_enclosure_has_no_tube(tmp_path: Path) -> None:
    class Escaping(OdeSystem):
        name, states, positions = "escaping", ("x",), ("x",)
        controls, control_units, input_bounds = ("u",), ("1",), ((-1.0, 1.0),)

        def xdot(self, x: Any, u: Any, psi: Any) -> list[Any]:
            return [x[0] ** 2 + u[0]]

    problem = Problem("out", Fleet(Escaping(), {}, start={"x": 1.0}), 2.0, 10, parse("G x >= -1"))
    with pytest.raises(UnsupportedError, match=r"geojson: nothing is proven of where the fleet is: .*runs away"):
        Plan(problem, np.zeros((10, 1)), "planned").export(tmp_path / "tube.geojson")


# --- tables and JSON


def integrated(plan: Plan, traction: float) -> Floats:
    """x, y and heading at the end, by an integrator that knows nothing of arcs."""
    state = [*plan.problem.fleet.position.tolist(), np.pi / 6]
    for v, omega in plan.controls:

        def rates(_: float, s: Floats, v: float = v, omega: float = omega) -> list[float]:
            return [traction * v * np.cos(s[2]), traction * v * np.sin(s[2]), traction * omega]

        state = solve_ivp(rates, (0, plan.problem.step), state, rtol=1e-10, atol=1e-12).y[:, -1].tolist()
    return np.array(state)


def test_the_table_holds_the_commands_and_where_the_members_are(tmp_path: Path) -> None:
    plan = made("one traction")
    with plan.export(tmp_path / "plan.csv", members=3).open() as file:
        header, *rows = list(csv.reader(file))
    assert header[:4] == ["t [s]", "v [m/s]", "omega [rad/s]", "x [m] (traction=0.8)"]
    assert len(rows) == 13
    assert rows[-1][1:3] == ["", ""]
    np.testing.assert_array_equal(np.array([row[:3] for row in rows[:-1]], dtype=float)[:, 1:], plan.controls)
    for k, traction in enumerate((0.8, 1.0, 1.2)):
        last = np.array(rows[-1][3 + 3 * k : 6 + 3 * k], dtype=float)
        np.testing.assert_allclose(last, integrated(plan, traction), atol=1e-7)


def test_without_members_the_table_is_that_of_the_results_folder(tmp_path: Path) -> None:
    from ensemble_ctrl.api.results import controls_csv

    plan = made("bicycle")
    assert plan.export(tmp_path / "plan.csv").read_text() == controls_csv(plan)


def test_headings_count_from_x_whatever_the_model_says(tmp_path: Path) -> None:
    plan = made("place and heading")
    data = json.loads(plan.export(tmp_path / "plan.json", members=9).read_text())
    for member in data["members"]:
        own = np.radians(30) + member["parameters"]["start_heading"] * -1
        assert member["heading"][0] == pytest.approx(np.radians(60) + np.radians(30) - own)
        move = np.diff([member["x"][:2], member["y"][:2]]).ravel()
        middle = (member["heading"][0] + member["heading"][1]) / 2
        ahead = np.sign(plan.controls[0, 0])
        np.testing.assert_allclose(move / np.linalg.norm(move), ahead * np.array([np.cos(middle), np.sin(middle)]))


def test_json_holds_everything(tmp_path: Path) -> None:
    plan = made("two tractions")
    data = json.loads(plan.export(tmp_path / "plan.json").read_text())
    assert data["controls"]["values"] == plan.controls.tolist()
    assert data["controls"]["units"] == ["m/s", "rad/s"]
    assert len(data["members"]) == 5
    assert len(data["times"]) == len(data["members"][0]["x"]) == 13
    again = load_text(json.dumps(data["problem"]))
    assert repr(again) == repr(plan.problem)


def test_a_data_frame(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    plan = made("one traction")
    table = plan.to_dataframe(members=2)
    assert table.index.name == "t [s]"
    assert table.shape == (13, 8)
    plan.export(tmp_path / "plan.csv", members=2)
    pandas.testing.assert_frame_equal(table, pandas.read_csv(tmp_path / "plan.csv", index_col=0))


def test_without_pandas_it_is_said_clearly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UnsupportedError, match="pandas is not installed: pip install pandas"):
        made("one traction").to_dataframe()


def test_other_systems_have_their_own_states(tmp_path: Path) -> None:
    text = """
    fleet: {model: double_integrator, parameters: {mass: {range: [0.9, 1.1]}}, start: {}}
    horizon: {duration: 2 s, steps: 8}
    task: G x >= -100
    """
    plan = Plan(load_text(text), np.tile([0.5, -0.25], (8, 1)), "planned")
    data = json.loads(plan.export(tmp_path / "plan.json", members=2).read_text())
    for member in data["members"]:
        acceleration = 0.5 / member["parameters"]["mass"]
        assert member["x"][-1] == pytest.approx(acceleration * 2**2 / 2)
    header = plan.export(tmp_path / "plan.csv", members=1).read_text().splitlines()[0]
    assert header.startswith("t [s],fx [N],fy [N],x [m] (mass=1),y [m] (mass=1)")


# --- several starts

STARTS = """
fleet:
  model: MODEL
  parameters: {PARAMETER: {range: [0.9, 1.1]}}
  start: {position: [1, 2]HEADING}
  starts: {ann: [0, 0], 'b"o, b': [-2, 0.5]}
horizon: {duration: 3 s, steps: 12}
task: G x >= -100
"""


def apart(model: str = "unicycle") -> Plan:
    """A plan of members at two places."""
    arcs = model == "unicycle"
    text = STARTS.replace("MODEL", model).replace("HEADING", ", heading: 30 deg" if arcs else "")
    controls = np.random.default_rng(3).uniform([0.2, -1.5], [1.0, 1.5], (12, 2))
    return Plan(load_text(text.replace("PARAMETER", "traction" if arcs else "gain")), controls, "planned")


def test_members_of_each_start_are_in_the_table(tmp_path: Path) -> None:
    plan = apart()
    with plan.export(tmp_path / "plan.csv", members=2).open() as file:
        header, *rows = list(csv.reader(file))
    wanted = [f"{start}, traction={value}" for start in ("ann", 'b"o, b') for value in (0.9, 1.1)]
    assert header[3::3] == [f"x [m] ({name})" for name in wanted]
    last = np.array(rows[-1][3:], dtype=float).reshape(4, 3)
    for k, traction in enumerate((0.9, 1.1)):
        one = replace(plan, problem=plan.problem.with_(fleet=plan.problem.fleet.of_one_start))
        alone = integrated(one, traction)
        np.testing.assert_allclose(last[k], alone, atol=1e-7)
        np.testing.assert_allclose(last[k + 2], alone + np.array([-2, 0.5, 0]), atol=1e-7)


def test_json_says_where_each_member_starts(tmp_path: Path) -> None:
    data = json.loads(apart().export(tmp_path / "plan.json", members=1).read_text())
    assert [(one["start"], one["x"][0], one["y"][0]) for one in data["members"]] == [("ann", 1, 2), ('b"o, b', -1, 2.5)]
    assert "start" not in json.loads(made("bicycle").export(tmp_path / "one.json").read_text())["members"][0]


@pytest.mark.parametrize("model", ["unicycle", "single_integrator"])
def test_every_start_has_its_own_tube(model: str, tmp_path: Path) -> None:
    plan = apart(model)
    data = json.loads(plan.export(tmp_path / "tube.geojson").read_text())
    whole, *steps = data["features"]
    assert whole["properties"]["starts"] == {"ann": [0, 0], 'b"o, b': [-2, 0.5]}
    assert len(steps) == 24
    for start in plan.problem.fleet.starts:
        own = [one for one in steps if one["properties"]["start"] == start]
        fleet = plan.problem.fleet.at_start(start)
        paths = fleet.trajectories(np.repeat(plan.controls, 7, axis=0), fleet.sample(60, 1), plan.problem.step / 7)
        for k, feature in enumerate(own):
            assert feature["properties"]["name"] == f"step {k} from start {start}"
            area = shapely.geometry.shape(feature["geometry"])
            during = paths[:, 7 * k : 7 * k + 8, :2].reshape(-1, 2)
            assert shapely.covers(area, shapely.points(during)).all()
            assert area.difference(shapely.MultiPoint(during).convex_hull.buffer(0.03)).area < 1e-9
            assert shapely.geometry.shape(whole["geometry"]).covers(area)


def test_too_many_members_of_several_starts_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ProblemError, match=r"^members: expected a number from 0 to 500 at each of 2 starts, got 501$"):
        apart().export(tmp_path / "plan.csv", members=501)


@pytest.mark.parametrize("model", ["unicycle", "single_integrator"])
def test_a_bag_has_the_paths_of_every_start(model: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    messages = bag_of(apart(model).export(tmp_path / "plan", "rosbag", members=2))
    begins = [messages[f"/member_{k}/path"][0][1].poses[0].pose.position for k in range(4)]
    assert [(place.x, place.y) for place in begins] == [(1, 2), (1, 2), (-1, 2.5), (-1, 2.5)]


# --- ROS 2 bags


def bag_of(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """The messages of a bag by topic, with their times."""
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    found: dict[str, list[tuple[int, Any]]] = {}
    with rosbag2.Reader(path) as reader:
        for connection in reader.connections:
            if connection.msgtype not in store.types:
                store.register(typesys.get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, time, raw in reader.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((time, message))
    return found


def test_a_bag_holds_commands_and_paths(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    plan = made("one traction")
    messages = bag_of(plan.export(tmp_path / "plan", "rosbag", members=3))
    assert set(messages) == {"/cmd_vel", "/member_0/path", "/member_1/path", "/member_2/path"}
    sent = [(t, m.twist.linear.x, m.twist.angular.z) for t, m in messages["/cmd_vel"]]
    assert [t for t, _, _ in sent] == [250_000_000 * k for k in range(13)]
    np.testing.assert_array_equal([row[1:] for row in sent], [*plan.controls.tolist(), [0, 0]])
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages["/cmd_vel"]]
    assert stamps == [t for t, _, _ in sent]
    for k, traction in enumerate((0.8, 1.0, 1.2)):
        [(time, path)] = messages[f"/member_{k}/path"]
        last = path.poses[-1].pose
        heading = 2 * np.arctan2(last.orientation.z, last.orientation.w)
        x, y, wanted = integrated(plan, traction)
        assert (time, path.header.frame_id, len(path.poses)) == (0, "map", 13)
        np.testing.assert_allclose([last.position.x, last.position.y], [x, y], atol=1e-7)
        assert np.cos(heading - wanted) == pytest.approx(1)


def test_a_bicycle_gets_steering_angles(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    plan = made("bicycle")
    messages = bag_of(plan.export(tmp_path / "plan", "rosbag", members=0))
    sent = [[m.drive.speed, m.drive.steering_angle] for _, m in messages["/ackermann_cmd"]]
    np.testing.assert_allclose(sent[:-1], plan.controls, rtol=1e-6)


def test_a_bag_of_robots_in_space_has_their_places_and_attitudes(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    plan = ode_made("space")
    controls = plan.controls + np.array([0.0, 0.02, 0.05, 0.01])
    messages = bag_of(replace(plan, controls=controls).export(tmp_path / "plan", "rosbag", members=2))
    assert set(messages) == {"/commands", "/member_0/path", "/member_1/path"}
    sent = messages["/commands"]
    assert [t for t, _ in sent] == [100_000_000 * k for k in range(11)]
    assert {m.layout.dim[0].label for _, m in sent} == {"thrust, tau_x, tau_y, tau_z"}
    assert isinstance(plan.problem, Problem)
    rest = plan.problem.fleet.rest(plan.problem.fleet.center)
    np.testing.assert_array_equal([m.data for _, m in sent], [*controls.tolist(), rest])
    for k, member in enumerate(plan.problem.fleet.spread(2)):
        wanted = states(plan.problem, controls, member[None])[0]
        poses = [stamped.pose for stamped in messages[f"/member_{k}/path"][0][1].poses]
        np.testing.assert_allclose([[p.position.x, p.position.y, p.position.z] for p in poses], wanted[:, :3])
        turns = np.array([[p.orientation.w, p.orientation.x, p.orientation.y, p.orientation.z] for p in poses])
        np.testing.assert_allclose(turns, wanted[:, 6:10], atol=1e-7)
        assert np.abs(turns[-1, 1:]).min() > 1e-4


def test_a_bag_of_a_vertical_plane_is_along_its_axes_and_thrust_is_along_the_robot_s_z(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    fleet = Fleet(PlanarQuadrotor(), {"mass": Interval(0.9, 1.1)}, start={"z": 2.0, "tilt": 0.3})
    problem = Problem("out", fleet, 1.0, 4, parse("G z >= 0"))
    plan = Plan(problem, np.tile([9.81, 0.01], (4, 1)), "planned")
    [(_, path)] = bag_of(plan.export(tmp_path / "plan", "rosbag", members=1))["/member_0/path"]
    pose, tilt = path.poses[0].pose, 0.3
    assert (pose.position.x, pose.position.y, pose.position.z) == (0.0, 0.0, 2.0)
    q = pose.orientation
    along = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(along, [-np.sin(tilt), 0.0, np.cos(tilt)], atol=1e-12)


def test_bags_replace_only_bags(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    plan = made("one traction")
    path = plan.export(tmp_path / "bag", "rosbag")
    with pytest.raises(EnsembleError, match="add --overwrite"):
        plan.export(path, "rosbag")
    plan.export(path, "rosbag", members=1, overwrite=True)
    assert sorted(bag_of(path)) == ["/cmd_vel", "/member_0/path"]
    (tmp_path / "mine").mkdir()
    with pytest.raises(EnsembleError, match="choose another name"):
        plan.export(tmp_path / "mine", "rosbag", overwrite=True)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["bag", "mine"]


@pytest.mark.parametrize("kind", ["beside a bag of ours", "with a file called metadata.yaml", "in a recorded bag"])
def test_no_file_of_the_user_s_is_lost_with_a_bag(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags")
    plan, path = made("one traction"), tmp_path / "bag"
    if kind == "beside a bag of ours":
        plan.export(path, "rosbag")
        (path / "thesis.tex").write_text("mine")
    elif kind == "in a recorded bag":
        plan.export(path, "rosbag")
        metadata = (path / "metadata.yaml").read_text()
        (path / "metadata.yaml").write_text(metadata.replace("ensemble-plan export", "a recorder"))
    else:
        path.mkdir()
        (path / "metadata.yaml").write_text("title: thesis")
        (path / "thesis.tex").write_text("mine")
    before = {entry.name: entry.read_bytes() for entry in path.iterdir()}
    with pytest.raises(EnsembleError, match="only a bag that an export wrote, and nothing beside it, is replaced"):
        plan.export(path, "rosbag", overwrite=True)
    assert {entry.name: entry.read_bytes() for entry in path.iterdir()} == before


def test_without_rosbags_it_is_said_clearly_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(UnsupportedError, match=r"pip install 'ensemble-ctrl\[ros\]'"):
        made("one traction").export(tmp_path / "bag", "rosbag")
    assert list(tmp_path.iterdir()) == []


# --- what is refused


@pytest.mark.parametrize(
    ("name", "form", "members", "message"),
    [
        ("plan.xyz", None, None, "expected one of csv, json, geojson, rosbag, got 'xyz'"),
        ("plan.csv", "xml", None, "got 'xml'"),
        ("plan.csv", None, -1, "from 0 to 1000, got -1"),
        ("plan.csv", None, 5000, "from 0 to 1000, got 5000"),
        ("none/plan.csv", None, None, "No such file"),
        ("there.csv", None, None, "add --overwrite"),
    ],
)
def test_mistakes(tmp_path: Path, name: str, form: str | None, members: int | None, message: str) -> None:
    (tmp_path / "there.csv").write_text("mine")
    with pytest.raises((ProblemError, EnsembleError), match=message):
        made("one traction").export(tmp_path / name, form, members=members)
    assert [entry.name for entry in tmp_path.iterdir()] == ["there.csv"]
    assert (tmp_path / "there.csv").read_text() == "mine"
