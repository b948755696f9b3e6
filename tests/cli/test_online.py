"""``ensemble-plan online``: what it prints, writes and leaves, also when something goes wrong."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from ensemble_ctrl.files.config import read
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.simulated import SimulatedRobot
from tests.paths import CONFIGS

from .conftest import Command
from .tools import FAST, SMALL

FOLDER = "plans/small-online"
ROBOT = "online: {deadline: 2 s, robot: {traction: 1.05, seed: 2}}\n"
"""A deadline that a busy machine meets too: a whole period of ten steps of 0.2 s."""


@pytest.fixture
def small(place: Path) -> Path:
    (place / "small.yaml").write_text(SMALL + ROBOT)
    return place


def log(place: Path, folder: str = FOLDER) -> list[dict[str, Any]]:
    """The lines of a log."""
    return [json.loads(line) for line in (place / folder / "log.jsonl").read_text().splitlines()]


def test_a_run_is_printed_logged_and_drawn(command: Command, small: Path) -> None:
    done = command("online", "small.yaml")
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    assert lines[0] == "small: success: done, and proven"
    assert lines[-1] == f"  files      {FOLDER}"
    assert any(line.startswith("  learnt     traction ") for line in lines)
    found = sorted(path.name for path in (small / FOLDER).iterdir())
    assert found == ["log.jsonl", "online.gif", "online.png", "outcome.json", "plan.npz"]
    start, *steps, end = log(small)
    assert (start["kind"], start["steps"], start["ranges"]) == ("start", 20, {"traction": [0.9, 1.1]})
    assert [step["begin"] for step in steps] == [0, 10]
    assert steps[0]["measurement"]["time"] == 0
    assert len(steps[0]["commands"]) == 10
    assert {"solve_seconds", "iterations", "status", "ranges", "proof", "source", "events"} <= set(steps[1])
    assert (end["kind"], end["ending"]) == ("end", "success")
    with Image.open(small / FOLDER / "online.gif") as video:
        assert getattr(video, "n_frames", 1) > 20
    facts = json.loads((small / FOLDER / "outcome.json").read_text())
    assert (facts["ending"], facts["assumptions_hold"], facts["plans"]["stopped"]) == ("success", True, 0)


def test_what_comes_on_the_way_is_logged_and_its_truth_is_told(command: Command, small: Path) -> None:
    coming = "box: [[1.6, 1.8], [1.5, 1.7]], appears: 1 s, vanishes: 3 s, seen_every: 1 s"
    motion = "motion: {velocity: [0.1, 0], uncertainty: {position: 1 cm, speed: 1 cm/s}}"
    text = SMALL.replace("avoid(block)", "avoid(obstacles)")
    loop = f"online: {{applied_steps: 3, deadline: 0.6 s, obstacles: {{cart: {{{coming}, {motion}}}}}}}"
    (small / "small.yaml").write_text(f"{text}{loop}\n")
    done = command("online", "small.yaml", "--json")
    facts = json.loads(done.out)
    assert facts["ending"] in ("success", "finished")
    told = [event.partition("s: ")[2] for event in facts["events"]]
    assert "an obstacle was added to the map: cart" in told
    assert "the motion of cart is predicted anew" in told
    assert "an obstacle was removed from the map: cart" in told
    assert facts["violations"]["robot"]["seconds"] == 0
    assert 0 < facts["violations"]["robot"]["clearance"] < 3


def test_what_comes_has_to_be_avoided_by_the_task(command: Command, place: Path) -> None:
    (place / "small.yaml").write_text(SMALL + "online: {obstacles: {cart: {box: [[0, 1], [5, 6]]}}}\n")
    done = command("online", "small.yaml")
    assert done.code == 2
    assert "expected a part of the task that avoids it, such as G avoid(obstacles)" in done.err


def test_errors_of_the_model_are_simulated_proven_and_told(command: Command, place: Path) -> None:
    bounds = "  uncertainty: {disturbance: {position: 5 mm/s, heading: 0.3 deg/s}, heading_hold: true}\n"
    robot = "online: {deadline: 2 s, robot: {traction: 1.05, errors: constant}}\n"
    (place / "small.yaml").write_text(SMALL.replace("horizon:", f"{bounds}horizon:") + robot)
    done = command("online", "small.yaml", "--no-plots")
    assert done.code == 0, done.err
    assert "  errors     position 0.005 m/s, heading 0.005236 rad/s, heading held within 1 s" in done.out
    start, *_ = log(place)
    assert start["uncertainty"]["disturbance"]["position"] == 0.005
    assert json.loads((place / FOLDER / "outcome.json").read_text())["assumptions_hold"] is True


def test_several_robots_are_told_and_drawn_by_name(command: Command, place: Path) -> None:
    robots = "{ada: {traction: 0.95, seed: 7}, ben: {traction: 1.04}}"
    (place / "small.yaml").write_text(SMALL + f"online: {{deadline: 2 s, robots: {robots}}}\n")
    done = command("online", "small.yaml", "--json")
    assert done.code == 0, done.err
    assert sorted(done.data["ranges"]) == ["ada.traction", "ben.traction"]
    assert done.data["ranges"]["ada.traction"][0] <= 0.95 <= done.data["ranges"]["ada.traction"][1]
    assert done.data["ranges"]["ben.traction"][0] <= 1.04 <= done.data["ranges"]["ben.traction"][1]
    _, *steps, _ = log(place)
    assert sorted(steps[-1]["measurements"]) == ["ada", "ben"]
    assert (place / FOLDER / "online.gif").exists()


def test_robots_that_are_not_told_apart_draw_noise_of_their_own(place: Path) -> None:
    (place / "small.yaml").write_text(SMALL + "online: {robots: {ada: {}, ben: {}, cleo: {seed: 9}}}\n")
    settings = read(str(place / "small.yaml")).problem.online
    assert settings is not None
    assert [robot.seed for robot in settings.robots.values()] == [0, 1, 9]
    assert [robot.seed for robot in settings.with_robots(seed=4).robots.values()] == [4, 5, 6]


def test_as_json_one_object(command: Command, small: Path) -> None:
    done = command("online", "small.yaml", "--json", "--no-plots", "-q", "--seed", "5")
    assert (done.code, done.err) == (0, "")
    assert (done.data["ending"], done.data["exit_code"], done.data["folder"]) == ("success", 0, FOLDER)
    assert not (small / FOLDER / "online.png").exists()


def test_a_robot_unlike_the_fleet_is_no_success(command: Command, small: Path) -> None:
    done = command("online", "small.yaml", "--no-plots", "--traction", "0.6")
    assert done.code == 4
    assert not done.out.startswith("small: success")
    assert "no parameters in the assumed ranges fit what was measured" in done.err
    assert log(small)[-1]["kind"] == "end"


def test_the_defaults_do_without_a_section(command: Command, place: Path) -> None:
    done = command("online", "small.yaml", "--no-plots", "--set", "online.deadline=2 s")
    assert done.code == 0, done.err


FREE = SMALL.replace("duration: 4 s", "duration: {at_most: 4 s}").replace("F[3, 4]", "F")
UNFIT = [
    (FREE, "unfit.yaml:6:21: error: horizon.duration: a free duration is not for a loop"),
    (SMALL + "objective: {earliest: goal}\n", "objective.earliest: the earliest passage is not for a loop"),
    (SMALL.replace("F[3, 4] in(goal)", "share(0.9, F[3, 4] in(goal))"), "task: a loop drives one robot"),
    (
        "fleet: {model: double_integrator, rate_bounds: {fx: 1}}\nhorizon: {duration: 1 s}\ntask: F x >= 0\n",
        "unfit.yaml:1:48: error: fleet.rate_bounds: bounds on the rates of commands are not for a loop of the double",
    ),
]


@pytest.mark.parametrize(("text", "message"), UNFIT)
def test_what_is_not_for_a_loop_is_told_with_its_place(command: Command, place: Path, text: str, message: str) -> None:
    (place / "unfit.yaml").write_text(text)
    done = command("online", "unfit.yaml")
    assert (done.code, done.out) == (2, "")
    assert message in done.err
    assert not (place / "plans").exists()
    assert command("check", "unfit.yaml").code == 0
    (place / "unfit.yaml").write_text(text + "online: {deadline: 0.1 s}\n")
    checked = command("check", "unfit.yaml")
    assert checked.code == 2
    assert message in checked.err


def test_without_a_plan_nothing_is_driven(command: Command, place: Path) -> None:
    done = command("online", "walled.yaml", *FAST, "--set=solve.time_limit=4")
    assert done.code == 3
    assert "walled: no plan was found to begin with" in done.err
    assert not (place / "plans").exists()


def test_a_signal_stops_the_robot_and_keeps_the_log(
    command: Command, small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wait = SimulatedRobot.wait

    def interrupted(self: SimulatedRobot, until: float) -> None:
        wait(self, until)
        if until >= 4.0 and not self._measure_count:  # type: ignore[attr-defined]
            self._measure_count = 1  # type: ignore[attr-defined]
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(SimulatedRobot, "wait", interrupted)
    monkeypatch.setattr(SimulatedRobot, "_measure_count", 0, raising=False)
    done = command("online", "small.yaml")
    assert done.code == 130
    assert "the robot is stopped; the log is kept" in done.err
    assert done.out.startswith("small: interrupted: someone wanted to stop")
    assert log(small)[-1]["ending"] == "interrupted"
    assert log(small)[-2]["kind"] == "step"


def test_a_fault_leaves_the_log_up_to_it(command: Command, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = SimulatedRobot.read

    def broken(self: SimulatedRobot) -> Measurement | None:
        if self.now() > 4.0:
            raise OSError(5, "the cable came off", "robot")
        return read(self)

    monkeypatch.setattr(SimulatedRobot, "read", broken)
    done = command("online", "small.yaml")
    assert done.code == 1
    assert "Traceback" not in done.err
    assert f"the log up to the fault: {FOLDER}/log.jsonl" in done.err
    assert "error: robot: the cable came off" in done.err
    end = log(small)[-1]
    assert end["ending"] == "fault"
    assert "the cable came off" in end["reason"]


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("{applied_steps: 0}", "online.applied_steps: expected a whole number from 1 to 10000, got 0"),
        ("{noise: {position: 3 s}}", "online.noise.position: expected a length"),
        ("{horizon: receding}", "expected run_for with `horizon: receding`"),
        ("{robot: {drifting: {middle: 1, amplitude: 0.1, period: 9 s}, traction: 1}}", "expected drifting alone"),
        ("{robot: {lost: {commands: 1}}}", "expected a share from 0 to below 1, got 1"),
        ("{robot: {errors: worst}}", "online.robot.errors: 'worst' is not one of random, bang-bang, constant, none"),
        ("{robot: {uncertainty: {varies: {grip: 1 %}}}}", "online.robot.uncertainty.varies.grip: unknown name"),
        ("{robot: {uncertainty: {delay: 1 m}}}", "online.robot.uncertainty.delay: expected a time in s"),
        ("{actuators: {speed: 1 cm/s}}", "online.actuators: moved to fleet.uncertainty.actuators"),
        ("{robbot: {}}", "robbot"),
        ("{robot: {traction: 1}, robots: {ada: {}}}", "expected robot, or robots by name, got both"),
        ("{robots: {2nd: {}}}", "expected a name that starts with a letter"),
        ("{robots: {ada: {traction: 0}}}", "online.robots.ada.traction: expected"),
        ("{deadline: 9 s}", "online.deadline: expected at most the 2 s of 10 applied steps, got 9 s"),
        ("{obstacles: {cart: {appears: 1 s}}}", "online.obstacles.cart: expected exactly one of box"),
        ("{obstacles: {goal: {box: [[0, 1], [5, 6]]}}}", "online.obstacles.goal: expected a new name, got 'goal'"),
        (
            "{obstacles: {cart: {box: [[0, 1], [5, 6]], appears: 2 s, vanishes: 1 s}}}",
            "online.obstacles.cart.vanishes: expected a time after it appears, at 2 s, got 1 s",
        ),
        (
            "{obstacles: {cart: {box: [[0, 1], [5, 6]], seen_every: 1 s}}}",
            "online.obstacles.cart.seen_every: expected a motion to predict anew, got none",
        ),
        (
            "{obstacles: {cart: {box: [[0, 1], [5, 6]], motion: {velocity: [1, 0], uncertainty: {since: 1 s}}}}}",
            "online.obstacles.cart.motion.uncertainty.since: expected none, since it is predicted when it appears",
        ),
        ("{obstacles: {cart: {box: [[0, 1], [5, 6]], strays: off}}}", "is not one of towards, away, random, none"),
        ("{robot: {traction: 1, angular_traction: 1}}", "expected traction, or linear_traction and angular_traction"),
    ],
)
def test_mistakes_are_told(command: Command, place: Path, section: str, said: str) -> None:
    (place / "small.yaml").write_text(SMALL + f"online: {section}\n")
    done = command("online", "small.yaml")
    assert done.code == 2
    assert said in done.err
    assert "Traceback" not in done.err
    assert not (place / "plans").exists()


def test_traction_is_for_robots_on_arcs(command: Command, place: Path) -> None:
    (place / "mass.yaml").write_text((CONFIGS / "systems" / "unknown_mass.yaml").read_text(encoding="utf-8"))
    done = command("online", "mass.yaml", "--traction", "0.9")
    assert done.code == 2
    assert "--traction: expected a robot on arcs, got unknown_mass, a double_integrator" in done.err
    assert "--set 'online.robot.parameters={mass: X}'" in done.err
