"""``ensemble-plan online``: plan, then run the loop on simulated robots, and write what happened."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import complain, fail, say
from ensemble_ctrl.cli.watch import Shown, Steps, Watch, first_event, shown
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import first_of
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config import read
from ensemble_ctrl.files.folder import ResultsFolder
from ensemble_ctrl.planning.baseline import unconstrained
from ensemble_ctrl.planning.online.begin import loop_for
from ensemble_ctrl.planning.online.driver import Loop, Outcome, Scene, drive
from ensemble_ctrl.planning.online.log import RunLog
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.published import violations
from ensemble_ctrl.planning.online.remaining import of_each, of_one_robot
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.simulated import FINE, Fixed, SimulatedFleet
from ensemble_ctrl.planning.online.simulated_obstacles import SimulatedScene
from ensemble_ctrl.planning.online.simulated_states import SimulatedStates
from ensemble_ctrl.planning.online.step import Step
from ensemble_ctrl.planning.planner import solve
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.errors import errors_text
from ensemble_ctrl.report.online import Reported, Run, write_run

Floats = NDArray[np.float64]

STOPPING = "the robot is stopped; the log is kept"


@dataclass(frozen=True)
class OnlineRun:
    """The options of one call, as given."""

    config: str
    output: Path | None = None
    overrides: tuple[str, ...] = ()
    traction: float | None = None
    seed: int | None = None
    json: bool = False
    quiet: bool = False
    plots: bool = True
    overwrite: bool = False
    watch: bool = False
    browser: bool = True


def run_online(options: OnlineRun) -> int:
    """Plan, run the loop, write the folder, print the summary; returns the exit code."""
    with shown(options.quiet) as progress:
        return _run(options, progress)


def _run(options: OnlineRun, progress: Shown) -> int:
    """The same, with whom to tell."""
    progress("check", None)
    loaded = read(options.config, options.overrides, loop=True)
    for line in first_of(loaded.warnings):
        progress.note(line)
    _require_arcs(loaded.problem, options)
    settings = (loaded.problem.online or OnlineSettings()).with_robots(options.traction, options.seed)
    problem = loaded.problem
    folder = ResultsFolder(options.output, f"{problem.name}-online", options.overwrite)
    fleet, scene = settings.simulated(problem), SimulatedScene(settings.obstacles)
    if options.watch:
        progress.page = Watch("loop", of_one_robot(problem), options.browser)

    def abandon() -> None:
        fleet.stop()
        folder.commit()

    drawn = ""
    try:
        with stoppable(progress, abandon, STOPPING):
            first = _first_plan(problem, progress)
            if first is None or progress.stop_signal is not None:
                return _without_plan(problem, progress, options)
            first.save(folder.working / "plan.npz")
            loop = loop_for(problem, settings.options, first.controls, tuple(fleet.robots))
            progress.tell(lambda: first_event(first.problem, first.controls))
            progress("drive", None)
            try:
                outcome, reported = _driven(loop, fleet, scene, folder.working / "log.jsonl", progress)
            except BaseException:
                complain(f"the log up to the fault: {folder.commit() / 'log.jsonl'}")
                raise
            if options.plots and progress.stop_signal is None:
                progress("draw", None)
                drawn = _draw(problem, loop, fleet, scene, outcome, reported, first.controls, folder.working)
        facts = _facts(loop, outcome) | {"violations": _violations(problem, fleet, scene, outcome)}
        put_file(folder.working / "outcome.json", to_json(facts, indent=2) + "\n")
        placed = folder.commit()
    finally:
        folder.discard()
    progress.finish()
    if drawn:
        complain(f"error: {placed}: the run is logged, but its figures could not be drawn ({drawn})")
    code = codes.of_signal(progress.stop_signal) if outcome.ending == "interrupted" else exit_code(outcome)
    _print(problem, facts, outcome, str(placed), options, code)
    return code


def _without_plan(problem: Problem, progress: Progress, options: OnlineRun) -> int:
    """There is nothing to begin with."""
    if progress.stop_signal is not None:
        return fail(codes.of_signal(progress.stop_signal), "interrupted; the robot has not moved", options.json)
    hint = "`ensemble-plan run` says what conflicts"
    return fail(codes.NO_PLAN, f"{problem.name}: no plan was found to begin with; {hint}", options.json)


def exit_code(outcome: Outcome) -> int:
    """Success is the only ending that is one."""
    return codes.OK if outcome.ending == "success" else codes.NOT_VERIFIED


def _require_arcs(problem: Problem, options: OnlineRun) -> None:
    """Refuse a factor on the speed of robots that have none."""
    system = problem.fleet.system
    if options.traction is not None and not system.on_arcs:
        names = ", ".join(f"{name}: X" for name in system.parameters) or "NAME: X"
        raise UsageError(
            f"--traction: expected a robot on arcs, got {problem.name}, a {system.name}; "
            f"instead: --set 'online.robot.parameters={{{names}}}'"
        )


def _first_plan(problem: Problem, progress: Progress) -> Plan | None:
    """The plan that the loop begins with; None if there is none."""
    alone = problem if problem.fleet.starts else of_one_robot(problem)
    found = solve(alone, progress=progress)
    # the published program has a solution where the planner's own measure of the mean robot may fall short
    published = alone.solve.as_published and any(one.attempt is not None for one in found.rounds)
    return Plan(alone, found.controls, found.status) if published or found.status == "planned" else None


def _driven(
    loop: Loop, fleet: SimulatedFleet, scene: SimulatedScene, path: Path, progress: Shown
) -> tuple[Outcome, list[Reported]]:
    """Run the loop with its log."""
    reported: list[Reported] = []
    steps = Steps(loop.problem)
    with RunLog(path) as log:
        log.start(loop)

        def listen(step: Step, controls: Floats) -> None:
            log.step(loop, step, controls)
            progress.tell(lambda: steps(loop, step))
            time = step.begin * loop.problem.step
            paths = {name: loop.predicted(name) for name in loop.trackers}
            reported.append(Reported(time, paths, step.ranges, step.seconds, step.source))
            for event in step.events:
                progress.note(f"t = {time:.1f} s: {event}")

        try:
            wanted = lambda: progress.stop_signal is not None  # noqa: E731
            outcome = drive(loop, fleet, fleet, wanted=wanted, listener=listen, scene=_advancing(scene, loop, fleet))
        except BaseException as error:
            log.fault(error)
            raise
        log.end(outcome)
        progress.tell(lambda: steps.end(loop, outcome))
    return outcome, reported


def _advancing(scene: SimulatedScene, loop: Loop, fleet: SimulatedFleet) -> Scene | None:
    """What changes the map of a loop, if anything does: only loops of robots on arcs have such a map."""
    if not scene.obstacles:
        return None
    assert isinstance(loop, Receding), "refused when the problem was read"
    changing = loop
    return lambda now: scene.advance(changing, now, np.array([robot.pose[:2] for robot in fleet.robots.values()]))


def _draw(
    problem: Problem,
    loop: Loop,
    fleet: SimulatedFleet,
    scene: SimulatedScene,
    outcome: Outcome,
    reported: list[Reported],
    first: Floats,
    folder: Path,
) -> str:
    """Draw the pictures; returns why that failed, if it did: the log is worth keeping without them."""
    try:
        baseline = None
        if problem.report.baseline:
            found = solve(unconstrained(of_one_robot(problem)))
            baseline = found.controls if found.status == "planned" else None
        began = round(outcome.start / problem.step) * FINE
        places = problem.fleet.place_columns
        # robots on arcs stand at the end, others move on
        end = None if problem.fleet.system.on_arcs else began + loop.steps * FINE + 1
        driven = {name: np.array(robot.track)[began:end, places] for name, robot in fleet.robots.items()}
        seconds = (len(next(iter(driven.values()))) - 1) * problem.step / FINE
        title = f"{problem.name}: {outcome.ending}, {outcome.reason}"
        run = Run(
            problem if loop.base or scene.obstacles or problem.fleet.starts else loop.problem,
            first,
            reported,
            outcome.paths,
            driven,
            seconds,
            loop.options.deadline,
            _truth(loop, fleet),
            title,
            baseline,
            scene.avoided(problem),
        )
        write_run(run, folder)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def _truth(loop: Loop, fleet: SimulatedFleet) -> dict[str, float]:
    """True parameters, where they stay the same, by the names that a step has for them."""
    truth: dict[str, float] = {}
    for name, robot in fleet.robots.items():
        if isinstance(robot, SimulatedStates):
            truth |= robot.fleet.named(robot.member)
        elif isinstance(robot.factors, Fixed):
            speed, turn_rate = robot.factors.speed, robot.factors.turn_rate
            factors = {"traction": speed, "linear_traction": speed, "angular_traction": turn_rate}
            truth |= {loop.label(name, parameter): factors[parameter] for parameter in loop.problem.fleet.names}
    return truth


def _violations(
    problem: Problem, fleet: SimulatedFleet, scene: SimulatedScene, outcome: Outcome
) -> dict[str, dict[str, float | None]]:
    """What each simulated robot's true track did since the plan began; no clearance where nothing is avoided."""
    began = round(outcome.start / problem.step) * FINE
    each, came = of_each(problem, tuple(fleet.robots)), scene.avoided(problem)
    found: dict[str, dict[str, float | None]] = {}
    for name, robot in fleet.robots.items():
        track = np.array(robot.track)[began : began + problem.steps * FINE + 1, problem.fleet.place_columns]
        one = violations(each[name], track, FINE, came)
        found[name] = {key: value if np.isfinite(value) else None for key, value in one.items()}
    return found


def _facts(loop: Loop, outcome: Outcome) -> dict[str, object]:
    """How the run ended, as plain data."""
    seconds = outcome.seconds
    last = outcome.steps[-1] if outcome.steps else None
    return {
        "schema": SCHEMA,
        "name": loop.problem.name,
        "ending": outcome.ending,
        "reason": outcome.reason,
        "robustness": outcome.robustness,
        "assumptions_hold": loop.holds,
        "ranges": None if last is None else last.ranges,
        "plans": outcome.sources,
        "planning_seconds": {
            "median": float(np.median(seconds)) if len(seconds) else None,
            "largest": float(seconds.max()) if len(seconds) else None,
        },
        "events": [f"t = {s.begin * loop.problem.step:.1f} s: {event}" for s in outcome.steps for event in s.events],
    }


def _of_tracks(facts: Mapping[str, object]) -> list[tuple[str, dict[str, float]]]:
    """What true tracks did, where there was something to keep out of."""
    found = facts.get("violations")
    pairs = found.items() if isinstance(found, dict) else ()
    return [(name, one) for name, one in pairs if one["clearance"] is not None]


def _print(
    problem: Problem, facts: Mapping[str, object], outcome: Outcome, folder: str, options: OnlineRun, code: int
) -> None:
    """The result on stdout."""
    if options.json:
        say(to_json({**facts, "exit_code": code, "folder": folder}), folder)
        return
    seconds = outcome.seconds
    sources = ", ".join(f"{count} {name}" for name, count in outcome.sources.items() if count)
    errors = [("errors", errors_text(problem.fleet))] if problem.fleet.uncertainty else []
    rows = [("task", str(problem.task)), *errors, ("plans", sources)]
    if len(seconds):
        rows.append(("planning", f"{1e3 * np.median(seconds):.0f} ms median, {1e3 * seconds.max():.0f} ms at most"))
    if outcome.steps:
        ranges = outcome.steps[-1].ranges
        rows += [("learnt", f"{name} {low:.4g} to {high:.4g}") for name, (low, high) in ranges.items()]
    if np.isfinite(outcome.robustness):
        rows.append(("robustness", f"{outcome.robustness:.3f} m at least, by the measurements"))
    for name, one in _of_tracks(facts):
        inside = f"{one['seconds']:.2f} s inside an obstacle, clearance {one['clearance']:.3f} m"
        rows.append(("true track", inside if name == "robot" else f"{name}: {inside}"))
    rows.append(("files", folder))
    head = f"{problem.name}: {outcome.ending}: {outcome.reason}"
    say("\n".join([head, *(f"  {label:<11}{text}" for label, text in rows)]), folder)
