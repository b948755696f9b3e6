"""Pages, pictures and animations of fleets that follow a differential equation."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.files.config import load_text
from ensemble_ctrl.problem.evaluation.sampled import states, trajectories
from ensemble_ctrl.report.html import report_html
from ensemble_ctrl.report.kinds.moments import moments
from ensemble_ctrl.report.map_content import map_contents
from ensemble_ctrl.report.plot import KINDS, write_plot
from ensemble_ctrl.report.raster import HEAD, NARROW, Raster
from ensemble_ctrl.report.series import by_parameter, over_time
from ensemble_ctrl.report.text import parameter_label
from tests.examples import quick
from tests.ocp.problems import five

from .plans import ODE_KINDS, ode_made
from .test_page import Reader

MASSES = """
fleet: {{model: double_integrator, parameters: {{mass: {{range: [0.9, 1.1]}}}}, start: {{vx: {start}}}}}
horizon: {{duration: 2 s, steps: 10}}
task: {task}
"""
"""Point masses at rest."""
VIEWS = {"plane": ("xy",), "space": ("xy", "xz"), "line": ("tx",), "equal line": ("tx",)}
"""What runs along both axes of each map."""


@pytest.mark.parametrize("kind", ODE_KINDS)
def test_a_page_for_every_kind_of_fleet(kind: str) -> None:
    plan = ode_made(kind)
    text = report_html(plan, "task: none\n")
    reader = Reader(text)
    assert reader.open == []
    drawn = re.sub(r"<pre>.*?</pre>|<script.*</script>", "", text, flags=re.DOTALL)
    assert not re.findall(r"(?<![-\w])(nan|inf)(?![-\w])", drawn)
    wanted = ["Map", "Certificate", "Controls", "Robustness over time", "Clearance over the parameter"]
    assert reader.text["h2"][:5] == wanted
    assert "No certificate was asked for" in text
    assert len(reader.all("map")) == len(VIEWS[kind])
    slices = 1 if kind == "equal line" else 16
    assert len(reader.all("tube")) == slices * len(VIEWS[kind])
    assert "where every robot is proven to be" in text
    assert len(reader.all("region")) == len(plan.problem.regions) * len(VIEWS[kind])
    assert len(reader.all("obstacle")) == len(plan.problem.obstacles) * len(VIEWS[kind])
    assert ("mark" in {a.get("class") for _, a in reader.elements}) == (kind == "line")  # its task fails
    assert f'class="verdict {"bad" if kind == "line" else "open"}"' in text


@pytest.mark.parametrize("kind", ODE_KINDS)
def test_members_are_in_every_view_where_the_controls_bring_them(kind: str) -> None:
    plan = ode_made(kind)
    fleet = plan.problem.fleet
    reader = Reader(report_html(plan, ""))
    motion = json.loads(next(text for text in reader.text["script"] if text.startswith("{")))
    tracks = np.array(motion["members"], dtype=float) / 10
    paths = trajectories(plan.problem, plan.controls, fleet.spread(15 if fleet.names else 1), 2)
    times = np.broadcast_to(np.array(motion["times"]), paths.shape[:2])
    coordinates = {"t": times} | {name: paths[..., k] for k, name in enumerate(fleet.places)}
    views = np.split(tracks, len(VIEWS[kind]))
    assert len(reader.all("member")) == len(tracks)
    for axes, view in zip(VIEWS[kind], views, strict=True):
        for k, (name, sign) in enumerate(zip(axes, (1, -1), strict=True)):
            if np.ptp(coordinates[name]) < 1e-9:
                assert np.ptp(view[..., k]) == 0
                continue
            slope, level = np.polyfit(coordinates[name].ravel(), view[..., k].ravel(), 1)
            assert slope * sign > 0
            assert view[..., k] == pytest.approx(slope * coordinates[name] + level, abs=0.11)


def test_a_failure_is_marked_when_it_happens() -> None:
    """Where time runs along x: between the start's disk and the members, which are drawn at the end."""
    plan = ode_made("line")
    reader = Reader(report_html(plan, ""))
    (start,), end, (mark, *_) = reader.all("start"), reader.all("member")[0], reader.all("mark")
    begin, finish, found = (float(a["cx"] or 0) for a in (start, end, mark))
    time = plan.conflicts()[0].time
    assert time == pytest.approx(1.5)
    assert found == pytest.approx(begin + time / 2.0 * (finish - begin), abs=0.2)


@pytest.mark.parametrize("kind", ODE_KINDS)
def test_the_worst_of_every_value_is_the_replays(kind: str) -> None:
    """Against the replay, which goes through the task another way; with several parameters the worst of the others."""
    plan = ode_made(kind)
    members = plan.problem.fleet.grid(121 if len(plan.problem.fleet.names) < 2 else 600)
    run = plan.replay(parameters=members, substeps=2)
    profile = by_parameter(plan.problem, plan.controls)
    found = np.minimum.reduce(list(profile.curves.values()))
    for value, least in zip(profile.values, found, strict=True):
        same = members[:, 0] == value if plan.problem.fleet.names else np.ones(1, dtype=bool)
        assert least == pytest.approx(run.robustness[same].min(), abs=1e-9)


def test_a_state_of_the_task_is_shown_over_time() -> None:
    plan = ode_made("plane")
    _, series = over_time(plan.problem, plan.controls)
    (limit,) = [s for s in series if s.name == "-vx >= -3"]
    speed = states(plan.problem, plan.controls, plan.problem.fleet.corners)[..., 2]
    assert limit.low == pytest.approx(3 - speed.max(axis=0), abs=1e-9)
    assert limit.high == pytest.approx(3 - speed.min(axis=0), abs=1e-9)


def test_the_first_moment_is_the_mean_position() -> None:
    """In closed form: a constant force, and the mean of 1/mass over the range."""
    plan = ode_made("plane")
    name, first = next(iter(moments(plan.problem, plan.controls)))
    mean = np.log(1.2 / 0.8) / 0.4
    assert name == "m_{0}"
    assert first[:, 0] / np.sqrt(2) == pytest.approx(0.5 * plan.problem.times + 0.2 * mean * plan.problem.times**2)


@pytest.mark.parametrize("kind", quick(ODE_KINDS, "plane", "line"))
def test_pictures(kind: str, tmp_path: Path) -> None:
    plan = ode_made(kind)
    plan = replace(plan, certificate=plan.certify())
    for picture in KINDS:
        dark = np.asarray(Image.open(write_plot(plan, picture, tmp_path / "a.png")).convert("L")) < 128
        assert dark.any()
        assert not dark[:, :3].any()  # nothing is cut off
        assert not dark[:, -3:].any()
        assert not dark[:3].any()
        assert not dark[-3:].any()


@pytest.mark.parametrize("kind", ODE_KINDS)
def test_a_gif(kind: str, tmp_path: Path) -> None:
    path = ode_made(kind).animate(tmp_path / "a.gif", seconds=0.4)
    with Image.open(path) as picture:
        assert picture.width == NARROW
        assert picture.n_frames == 6  # type: ignore[attr-defined]
    assert path.stat().st_size < 100_000


def test_a_robot_on_a_line_is_where_it_is_at_the_time(tmp_path: Path) -> None:
    """The foremost of what differs from the first picture is the robot, against half the force times time squared."""
    plan = ode_made("equal line")
    (content,) = map_contents(plan.problem, trajectories(plan.problem, plan.controls, np.zeros((1, 0)), 2))
    canvas = content.canvas(NARROW, top=HEAD)
    with Image.open(plan.animate(tmp_path / "a.gif", seconds=2.0)) as picture:
        inside = slice(HEAD, HEAD + round(canvas.height))
        first = np.asarray(picture.convert("RGB")).astype(int)[inside]
        for frame in (8, 15, 22):
            picture.seek(frame)
            changed = np.abs(np.asarray(picture.convert("RGB")).astype(int)[inside] - first).max(axis=2) > 40
            rows, columns = np.nonzero(changed)
            time = 2.0 * frame / 25
            expected = canvas.at(np.array([time, time**2 / 2]))
            ahead = columns > columns.max() - 8
            assert columns[ahead].mean() == pytest.approx(expected[0], abs=2.5)
            assert rows[ahead].mean() + HEAD == pytest.approx(expected[1], abs=2.5)


def test_what_lies_beside_the_way_is_only_outlined() -> None:
    """Seen from above the ground hides everything, from the side the wall beside the fleet does."""
    plan = ode_made("space")
    above, side = map_contents(plan.problem, trajectories(plan.problem, plan.controls, plan.problem.fleet.corners))
    assert [shape.beside for shape in above.obstacles] == [(False, False), (True,)]
    assert [shape.beside for shape in side.obstacles] == [(True, True), (False,)]
    raster = Raster.of(plan.problem, trajectories(plan.problem, plan.controls, plan.problem.fleet.corners), NARROW)
    upper, lower = (panel.canvas for panel in raster.panels)
    assert lower.top == pytest.approx(upper.top + upper.height)


def test_curves_of_robustness_are_those_that_come_closest_while_they_are_required() -> None:
    """Of seven places, one fails before it is required, and is far from it then: it is left out."""
    bounds = " and ".join(f"x <= {2 + k / 10:g}" for k in range(6))
    problem = load_text(MASSES.format(task=f"G ({bounds}) and G[1.9,2] (vx <= 10)", start=19))
    controls = np.zeros((10, 2))
    controls[0, 0] = -100.0  # braked within the first step
    _, series = over_time(problem, controls)
    assert [one.name for one in series] == [f"-x >= {-2 - k / 10:g}" for k in range(6)]


def test_labels_name_units() -> None:
    """Of parameters that the system gives a unit, of starts, and of factors."""
    problem = load_text(MASSES.format(task="G x <= 3", start=0))
    assert parameter_label(problem, "mass") == "mass [kg]"
    assert parameter_label(problem, "start_vx") == "start_vx [m/s]"
    assert parameter_label(five(), "traction") == "traction [-]"


def test_a_bound_in_mixed_units_stays_beside_its_bar() -> None:
    plan = Plan(load_text(MASSES.format(task="G[1,2] (x <= 3 and vx <= 3)", start=0)), np.zeros((10, 2)), "planned")
    plan = replace(plan, certificate=plan.certify())
    ax = plan.plot("certificate", ax=Figure(figsize=(3.5, 2.3)).subplots())
    assert [one.get_text() for one in ax.texts] == ["3 SI"]
    assert ax.get_xlabel().endswith("[SI]")
