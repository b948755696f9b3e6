"""Patches of terrain in a problem file: what is read and refused, kept, drawn, planned and said."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ensemble_ctrl as ec
from ensemble_ctrl.api.planning import failure_message
from ensemble_ctrl.api.results import summary, write_results
from ensemble_ctrl.certificate import claim, differences
from ensemble_ctrl.certificate.__main__ import main as check_alone
from ensemble_ctrl.cli.app import invoke as main
from ensemble_ctrl.core.plain import to_json
from ensemble_ctrl.files.config import dump, to_data
from ensemble_ctrl.ocp.terrain import crossed
from ensemble_ctrl.planning.suggest import suggest
from ensemble_ctrl.problem.plain import problem_of, proven_part
from ensemble_ctrl.report.html import report_html
from ensemble_ctrl.report.text import summary_lines

TEXT = """\
fleet:
  model: unicycle
  start: {position: [0, 0], heading: 0}
  parameters: {linear_traction: {range: [0.98, 1.02]}}
horizon: {duration: 8 s, steps: 40}
regions: {goal: {box: [[2.5, 3.5], [-0.5, 0.5]]}}
obstacles: {post: {box: [[1.0, 1.2], [0.9, 1.1]]}}
terrain:
  mud: {polygon: [[1.0, -0.6], [1.8, -0.6], [1.8, 0.6], [1.0, 0.6]], linear_traction: [0.5, 0.7]}
  ice: {areas: [{box: [[0, 1], [3, 4]]}, {disc: {center: [2, 3.5], radius: 0.3}}], angular_traction: [0.5, 1.2]}
task: F[7, 8] in(goal) and G avoid(post)
verify: {members: 60}
"""
STRAIGHT = np.array([[0.375, 0.0]] * 40)


def test_what_is_written_back_is_the_same_claim() -> None:
    problem = ec.load_text(TEXT)
    assert problem.terrain["mud"].parameters == {"linear_traction": (0.5, 0.7)}
    assert len(problem.terrain["ice"].pieces) == 2
    again = ec.load_text(dump(problem))
    assert again.errors == problem.errors != {}
    part = json.loads(to_json(proven_part(to_data(problem))))
    plain = problem_of(part | {"horizon": {"duration": 8.0, "steps": 40}})
    certificates = [ec.certify(one, STRAIGHT) for one in (problem, again, plain)]
    assert {one.inputs for one in certificates} == {certificates[0].inputs}
    assert certificates[0].proven == "undecided"  # who is slow in the mud is not at the goal
    assert ec.certify(problem.with_(terrain={}), STRAIGHT).proven == "yes"
    claimed = json.loads(to_json(claim(certificates[0])))
    assert not differences(claimed, certificates[2])
    claimed["uncertainty"]["terrain"]["mud"]["parameters"]["linear_traction"] = [0.6, 0.7]
    assert differences(claimed, certificates[2])


@pytest.mark.parametrize(
    ("mud", "wanted", "place"),
    [
        ("{box: [[0, 1], [0, 1]]}", "terrain.mud: expected the range of a parameter in it, got none", "9:8"),
        ("{box: [[0, 1], [0, 1]], grip: [0.5, 1]}", "terrain.mud.grip: expected parameters among traction", "9:32"),
        ("{traction: [0.5, 1]}", "terrain.mud: expected exactly one of box, polygon", "9:8"),
        ("{box: [[0, 1], [0, 1]], traction: 0.5}", r"terrain.mud.traction: expected \[low, high\], got 0.5", "9:42"),
        ("{box: [[0, 1], [0, 1]], traction: [0, 1]}", "terrain.mud.traction: expected a range above 0", "9:42"),
        ("{box: [[0, 1], [0, 1]], areas: [], traction: [1, 1]}", "terrain.mud.box: expected either areas or", "9:14"),
        ("{areas: [], traction: [1, 1]}", "terrain.mud.areas: expected at least one shape", "9:16"),
    ],
)
def test_what_is_wrong_is_shown_where_it_is(mud: str, wanted: str, place: str) -> None:
    lines = TEXT.splitlines()
    lines[8] = f"  mud: {mud}"
    with pytest.raises(ec.ConfigError, match=rf"{place}: error: {wanted}"):
        ec.load_text("\n".join(lines))


def test_names_and_systems_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ec.ConfigError, match=r"terrain.goal: 'goal' is the name of a region too"):
        ec.load_text(TEXT.replace("mud:", "goal:"))
    space = "fleet: {model: double_integrator, start: {x: 0}}\nhorizon: {duration: 1 s}\ntask: G x <= 1\n"
    with pytest.raises(ec.ConfigError, match="terrain: terrain is not for the double_integrator: patches change"):
        ec.load_text(space + "terrain: {mud: {box: [[0, 1], [0, 1]], mass: [1, 2]}}\n")
    for pieces, parameters in (
        ((), {"traction": (0.5, 1.0)}),
        ([[0, 1], [0, 1]], {}),
        ([[0, 1], [0, 1]], {"a": (2, 1)}),
    ):
        with pytest.raises(ec.EnsembleError, match="Patch"):
            ec.Patch(pieces, parameters)  # type: ignore[arg-type]


def test_a_plan_goes_round_and_is_proven_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = ec.plan(ec.load_text(TEXT))
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    path = plan.problem.fleet.trajectories(plan.controls, plan.problem.fleet.center[None], plan.problem.step)[0]
    assert not plan.problem.terrain["mud"].contains(path).any()
    lines = "\n".join(summary_lines(plan))
    assert "mud, linear_traction 0.5 to 0.7: kept out of" in lines
    assert "each with a sampled disturbance" in lines
    (tmp_path / "out").mkdir()
    write_results(plan, tmp_path / "out", ["ensemble-plan"])
    assert check_alone([str(tmp_path / "out")]) == 0
    assert main(["verify", str(tmp_path / "out")]) == 0
    assert "every disturbance within the bounds" in capsys.readouterr().out
    page = report_html(plan, dump(plan.problem))
    assert '<g class="patch"><title>mud; linear_traction 0.5 to 0.7</title>' in page
    assert "Brown: terrain" in page
    assert "mud" in plan.problem._repr_html_()
    assert summary(plan)["certificate"]["uncertainty"]["terrain"]["mud"]["parameters"] == {
        "linear_traction": [0.5, 0.7]
    }


def test_a_patch_that_makes_the_task_unprovable_is_named() -> None:
    wall = TEXT.replace("[[1.0, -0.6], [1.8, -0.6], [1.8, 0.6], [1.0, 0.6]]", "[[1, -9], [1.8, -9], [1.8, 9], [1, 9]]")
    problem = ec.load_text(wall + "solve: {time_limit: 12 s}\n")
    with pytest.raises(ec.SolveError, match="members may be in terrain mud from") as raised:
        ec.plan(problem.with_(solve=ec.SolveOptions(time_limit=0.1)))
    plan = raised.value.plan
    assert isinstance(plan, ec.Plan)
    assert "members may be in terrain mud" in failure_message(plan)
    found = suggest(problem, STRAIGHT)
    assert [one.change for one in found.helps] == ["no terrain mud"]


def test_speeds_and_headings_of_the_task_count_terrain() -> None:
    patch = {"mud": ec.Patch((ec.Obstacle.box([[1.0, 1.8], [-0.6, 0.6]]),), {"traction": (0.5, 1.5)})}
    turning = np.column_stack([np.full(40, 0.375), np.full(40, 0.05)])
    for task, off in (("G v <= 1", 0.375 * 0.52), ("G omega <= 1", 0.05 * 0.5), ("G heading <= 3", 0.05)):
        problem = ec.load_text(TEXT).with_(task=task, obstacles={})
        robust = [ec.certify(problem.with_(terrain=one), turning).robustness for one in (patch, {})]
        assert robust[0] < robust[1] - 0.9 * off, task
        worst = ec.replay(problem.with_(terrain=patch), turning, members=60, substeps=4).worst[0]
        assert robust[0] - 1e-9 <= worst < robust[1] + 1e-9


def test_each_start_meets_its_own_patches() -> None:
    two = TEXT.replace("heading: 0}", "heading: 0}\n  starts: {a: [0, 0], b: [0, 2.2]}").replace(
        "[-0.5, 0.5]", "[-3, 3]"
    )
    problem = ec.load_text(two.replace("post: {box: [[1.0, 1.2], [0.9, 1.1]]}", "post: {box: [[2, 2.2], [4.9, 5]]}"))
    both = ec.certify(problem, STRAIGHT)
    alone = [ec.certify(problem.with_(fleet=problem.fleet.at_start(name)), STRAIGHT) for name in ("a", "b")]
    assert both.robustness == pytest.approx(min(one.robustness for one in alone))
    assert alone[0].robustness < alone[1].robustness - 0.2  # only the members from a meet the mud
    run = ec.replay(problem, STRAIGHT, members=60)
    assert run.disturbed
    assert both.robustness - 1e-9 <= run.worst[0] < alone[1].robustness
    assert crossed(problem, STRAIGHT)["mud"].begin == pytest.approx(2.6, abs=0.21)
    with pytest.raises(ec.ConfigError, match=r"apart\(0.2 m\) is not supported for robots with errors of the model"):
        ec.load_text(two.replace("G avoid(post)", "G avoid(post) and G apart(0.2)"))


def test_the_legend_of_the_terrain_covers_no_name_and_nothing_of_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    from ensemble_ctrl.report import plot

    def looked_at(figure: Any, *_: Any) -> None:
        figure.canvas.draw()
        ax = figure.axes[0]
        covered = ax.get_legend().get_window_extent()
        assert not [text.get_text() for text in ax.texts if covered.overlaps(text.get_window_extent())]
        assert not [patch for patch in ax.patches if covered.overlaps(patch.get_window_extent())]

    monkeypatch.setattr(plot, "save", looked_at)
    problem = ec.load_text(TEXT.replace("{goal: ", "{all: {box: [[-1, 7], [-1, 5]]}, goal: "))
    drawn = SimpleNamespace(problem=problem, controls=STRAIGHT, baseline=None, certificate=None)
    plot.write_plot(drawn, "trajectories", Path("none.png"))
