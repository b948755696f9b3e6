"""``ensemble-plan run``: check, guess, solve, replay, write."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ensemble_ctrl.api import Plan, failure_message, plan
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.config import read
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report import summary_lines
from ensemble_ctrl.results import ResultsFolder, controls_csv, default_folder, summary, to_json, write_results


@dataclass(frozen=True)
class RunOptions:
    """The options of one run, as given."""

    config: str
    output: Path | None = None
    overrides: tuple[str, ...] = ()
    guess: Path | None = None
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    plots: bool = True
    overwrite: bool = False
    command: tuple[str, ...] = ()


def run(options: RunOptions) -> int:
    """Plan, write the results folder, print the summary; returns the exit code."""
    progress = Progress(options.quiet, options.verbose)
    progress("check", None)
    loaded = read(options.config, options.overrides)
    if not options.quiet:
        for warning in loaded.warnings:
            progress.note(str(warning))
    problem = loaded.problem
    guess = Plan.load(options.guess) if options.guess else None
    folder = ResultsFolder(options.output or default_folder(problem.name), options.overwrite)
    try:
        with stoppable(progress):
            found = plan(problem, progress=progress, guess=guess, log=folder.working / "solver.log", check=False)
        progress("write", None)
        written = _write(found, folder, options)
    except BaseException:
        folder.discard()
        raise
    progress.finish()
    _print(found, options, written)
    if written is None:
        return codes.INTERNAL
    return exit_code(found, progress.stop_signal)


def exit_code(found: Plan, stop_signal: int | None = None) -> int:
    """The exit code that a plan deserves."""
    if stop_signal is not None:
        return codes.TERMINATED if stop_signal == signal.SIGTERM else codes.INTERRUPTED
    if found.status == "infeasible":
        return codes.NO_PLAN
    if found.status != "planned":
        return codes.LIMIT
    return codes.OK if found.verified else codes.NOT_VERIFIED


def _write(found: Plan, folder: ResultsFolder, options: RunOptions) -> Path | None:
    """Write and place the results; None, with the reason on stderr, if the disk does not take them."""
    try:
        write_results(found, folder.working, options.command, options.plots)
        return folder.commit()
    except OSError as error:
        folder.discard()
        print(f"error: {folder.target}: the plan could not be written ({error.strerror or error})", file=sys.stderr)
        return None


def _print(found: Plan, options: RunOptions, written: Path | None) -> None:
    """The result on stdout: the summary or one JSON object, with the controls themselves if no file holds them."""
    if options.json:
        facts = {**summary(found), "folder": None if written is None else str(written)}
        if written is None:
            facts["controls"] = found.controls.tolist()
        print(to_json(facts))
        return
    print("\n".join(summary_lines(found, None if written is None else str(written))))
    if written is None:
        print("controls, since no file holds them:")
        print(controls_csv(found), end="")
    elif found.status == "infeasible" and not options.quiet:
        print(failure_message(found), file=sys.stderr)


def describe(problem: Problem) -> Sequence[str]:
    """The lines of ``check -v``: what the file says with every default filled in."""
    fleet, law = problem.fleet, problem.fleet.parameter
    order = "auto" if problem.order is None else str(problem.order)
    return [
        f"{problem.name}: {fleet.system.name}, {fleet.parameter_name} {law.lower:g} to {law.upper:g}",
        f"  horizon {problem.duration:g} s in {problem.steps} steps, order {order}, guarantee {problem.solve.guarantee}",
        f"  {len(problem.obstacles)} obstacle(s), {len(problem.regions)} region(s), task {problem.task}",
    ]
