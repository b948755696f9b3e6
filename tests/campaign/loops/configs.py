"""The problem files of `configs/online`, run by the command with robots of the campaign."""

from __future__ import annotations

import io
import json
from collections import Counter
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from ensemble_ctrl.cli import online
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.problem import Problem
from tests.paths import CONFIGS

from .judge import Judge, Judged, finite, number
from .robot import PARTS, Adversary
from .scene import Part, Scene
from .world import Ran, World, world_of

FOLDER = CONFIGS / "online"
OTHERS = "crossing_carts_online", "three_apart_online"
"""Obstacles that come while robots drive, and robots of several starts: judged in ``tests/planning/online`` instead."""
FILES = tuple(
    path
    for path in sorted(FOLDER.glob("*.yaml"))
    if "traction:" in path.read_text(encoding="utf-8") and not path.stem.startswith(("paper_", *OTHERS))
)
"""Loops of robots on arcs that prove what they do; the paper's, as published, does not."""


def scene_of(path: Path, seed: int) -> Scene:
    """A file as plain numbers, with robots at the bounds of its errors."""
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    fleet, settings = data["fleet"], data["online"]
    steps = data["horizon"]["steps"]
    rng = np.random.default_rng(seed)
    low, high = fleet["parameters"]["traction"]["range"]
    noise = ("corner", "alternate", "random", "late corner")
    robots = {
        name: Adversary(
            {"traction": float(rng.choice([low, high, rng.uniform(low, high)]))},
            noise=str(rng.choice(noise)),
            slip=str(rng.choice(("plus", "minus", "alternate"))),
            delay=0.1,
            lost=0.2,
            seed=seed,
        )
        for name in settings.get("robots", ("robot",))
    }
    goal = data["regions"]["goal"]["box"]
    begin, end = json.loads(data["task"].split(" in(goal)")[0].removeprefix("F"))
    return Scene(
        path.stem,
        fleet["model"],
        "x",
        1.0,
        {"traction": (low, high)},
        tuple(fleet["start"]["position"]),
        np.radians(float(fleet["start"]["heading"].removesuffix(" deg"))),
        float(str(fleet.get("radius", "0 m")).removesuffix(" m")),
        float(data["horizon"]["duration"].removesuffix(" s")) / steps,
        tuple((0.0, 0.0) for _ in range(steps)),
        {},
        {},
        {"goal": (*goal[0], *goal[1])},
        (Part("F", "goal", begin, end),),
        (0.0, float(data["horizon"]["duration"].removesuffix(" s"))),
        {"position": 0.01, "heading": float(np.radians(1.0)), "drift": 0.0},
        {"deadline": float(settings["deadline"].removesuffix(" s"))},
        robots,
        solids=tuple(map(_solid, data["obstacles"].values())),
        bounds=_bounds(fleet.get("uncertainty", {})),
    )


def _bounds(given: dict[str, Any]) -> dict[str, float]:
    """Errors beside the model as these files write them."""
    found = {"hold": 1.0} if given.get("heading_hold") else {}
    for name, value in {**given.get("disturbance", {}), **given.get("varies", {})}.items():
        number, unit = str(value).split()
        place = {"position": "place", "traction": "stray"}.get(name, name)
        found[place] = float(number) * {"mm/s": 1e-3, "deg/s": np.pi / 180, "%": 1e-2}[unit]
    return found


def _solid(shape: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    """The corners of a box or a polygon, which need not be convex."""
    if "polygon" in shape:
        return tuple((float(x), float(y)) for x, y in shape["polygon"])
    (x0, x1), (y0, y1) = shape["box"]
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


def judge_file(path: Path, seed: int, folder: Path) -> Judged:
    """Run the command on a file, and hold all that it writes and prints against the truth."""
    scene = scene_of(path, seed)
    referee = Judge(scene)
    world = world_of(scene)
    kept: list[tuple[Receding, Outcome]] = []

    def driving(loop: Receding, robot: World, clock: World, **more: Any) -> Outcome:
        world.loop = loop
        listener = more.pop("listener")

        def listen(step: Any, controls: Any) -> None:
            listener(step, controls)
            referee.step(world, step, controls)

        outcome = drive(loop, robot, clock, listener=listen, **more)
        kept.append((loop, outcome))
        return outcome

    def robots(self: OnlineSettings, problem: Problem) -> World:
        return world

    printed = io.StringIO()
    options = online.OnlineRun(str(path), folder / path.stem, json=True, quiet=True, plots=False)
    patched = patch.object(OnlineSettings, "simulated", robots), patch.object(online, "drive", driving)
    with patched[0], patched[1], patch.object(online, "FINE", PARTS), redirect_stdout(printed):
        code = online.run_online(options)
    loop, outcome = kept[0]
    lines = [json.loads(line) for line in (folder / path.stem / "log.jsonl").read_text().splitlines()]
    referee.end(Ran(world, loop, outcome, lines))
    facts = json.loads((folder / path.stem / "outcome.json").read_text())
    _outcome(referee, world, outcome, lines, facts)
    said = json.loads(printed.getvalue())
    same = {name: value for name, value in said.items() if name not in ("exit_code", "folder")}
    referee.hold(same == facts, "summary", "stdout is not outcome.json")
    referee.hold(said["exit_code"] == code == (0 if facts["ending"] == "success" else 4), "summary", "exit code")
    _summary(referee, loop, outcome, facts, options)
    return Judged(scene.family, outcome.ending, referee.proofs, referee.checks, tuple(referee.faults))


def _outcome(
    referee: Judge, world: World, outcome: Outcome, lines: list[dict[str, Any]], facts: dict[str, Any]
) -> None:
    """``outcome.json``, field by field, by the log and the truth."""
    steps, end = lines[1:-1], lines[-1]
    hold = referee.hold
    fields = {"schema", "name", "ending", "reason", "robustness", "assumptions_hold", "ranges", "plans"}
    hold(set(facts) == fields | {"planning_seconds", "events", "violations"}, "outcome", f"fields {sorted(facts)}")
    begin, window = round(world.start / referee.scene.step) * PARTS, (0.0, referee.scene.duration)
    for name, body in world.bodies.items():
        clear = referee.clearance(world, np.array(body.track)[begin:], 0.0, *window)
        said = facts["violations"][name]
        hold(abs(said["clearance"] - clear) < 1e-9 and said["seconds"] == 0, "outcome", f"violations of {name}")
    hold(facts["name"] == referee.scene.family, "outcome", "name")
    hold([facts["ending"], facts["reason"]] == [end["ending"], end["reason"]], "outcome", "ending")
    hold(number(facts["robustness"]) == finite(outcome.robustness), "outcome", "robustness")
    hold(facts["assumptions_hold"] is True, "outcome", "assumptions that do hold")
    for name, body in world.bodies.items():
        label = "traction" if len(world.bodies) == 1 else f"{name}.traction"
        low, high = facts["ranges"][label]
        hold(low <= body.factors(body.now)[0] <= high, "outcome", f"range {label}")
    counts = Counter(step["source"] for step in steps)
    hold({name: n for name, n in facts["plans"].items() if n} == dict(counts), "outcome", "plans")
    seconds = [step["seconds"] for step in steps if step["iterations"]]
    told = facts["planning_seconds"]
    hold(told["largest"] == max(seconds) and told["median"] == float(np.median(seconds)), "outcome", "seconds")
    events = [f"t = {step['time']:.1f} s: {event}" for step in steps for event in step["events"]]
    hold(facts["events"] == events, "outcome", "events")


def _summary(
    referee: Judge, loop: Receding, outcome: Outcome, facts: dict[str, Any], options: online.OnlineRun
) -> None:
    """The summary for people, line by line."""
    printed = io.StringIO()
    plain = online.OnlineRun(options.config, options.output, quiet=True, plots=False)
    with redirect_stdout(printed):
        online._print(loop.problem, facts, outcome, "the folder", plain, 0)
    head, *rows = printed.getvalue().rstrip().splitlines()
    said = [tuple(row.split(None, 1)) for row in rows]
    referee.hold(head == f"{facts['name']}: {facts['ending']}: {facts['reason']}", "summary", head)
    plans = ", ".join(f"{n} {name}" for name, n in facts["plans"].items() if n)
    learnt = [("learnt", f"{name} {low:.4g} to {high:.4g}") for name, (low, high) in facts["ranges"].items()]
    for row in [("plans", plans), *learnt, ("files", "the folder")]:
        referee.hold(row in said, "summary", f"{row} in {said}")
    if facts["robustness"] is not None:
        text = next(text for label, text in said if label == "robustness")
        referee.hold(float(text.split()[0]) <= facts["robustness"] + 5e-4, "summary", text)
