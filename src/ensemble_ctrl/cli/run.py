"""``ensemble-plan run``: check, guess, solve, replay, write."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ensemble_ctrl.api.planning import failure_message, plan, with_baseline, with_suggestions
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import controls_csv, summary, to_json, write_report, write_results
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.log import shown_log
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.streams import complain, fail, say
from ensemble_ctrl.cli.watch import Shown, Watch, shown
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import RunawayError, first_of
from ensemble_ctrl.files.config import read
from ensemble_ctrl.files.config.overrides import Given
from ensemble_ctrl.files.folder import ResultsFolder
from ensemble_ctrl.report import route_lines, summary_lines

if TYPE_CHECKING:
    from ensemble_ctrl.ocp.solvers import Iteration

REPORT = "report.html"
"""Name of a plan's page in its results folder."""


@dataclass(frozen=True)
class RunOptions:
    """The options of one run, as given."""

    config: str
    output: Path | None = None
    overrides: tuple[Given, ...] = ()
    guess: Path | None = None
    json: bool = False
    quiet: bool = False
    verbose: int = 0
    plots: bool = True
    animation: str | None = None
    suggest: bool = True
    overwrite: bool = False
    command: tuple[str, ...] = ()
    watch: bool = False
    browser: bool = True


@dataclass(frozen=True)
class Written:
    """Where the results are, if they could be written, and what could not be."""

    folder: Path | None
    error: str = ""


def run(options: RunOptions) -> int:
    """Plan, write the results folder, print the summary; returns the exit code."""
    with shown(options.quiet, options.verbose > 0) as progress:
        return _run(options, progress)


def _run(options: RunOptions, progress: Shown) -> int:
    """The same, with whom to tell."""
    if options.animation is not None:
        from ensemble_ctrl.report.video import require

        require(f"--animate {options.animation}", options.animation)
    progress("check", None)
    loaded = read(options.config, options.overrides)
    for line in first_of(loaded.warnings):
        progress.note(line)
    guess = Plan.load(options.guess) if options.guess else None
    if options.watch:
        progress.page = Watch("search", loaded.problem, options.browser)
    folder = ResultsFolder(options.output, loaded.problem.name, options.overwrite)

    def abandon() -> None:
        folder.discard()
        fail(codes.INTERRUPTED, "interrupted twice; nothing was kept", options.json)

    try:
        with stoppable(progress, abandon), shown_log(options.verbose, progress.stream):
            log = folder.working / "solver.log"
            found = plan(loaded.problem, progress=progress, guess=guess, log=log, check=False)
            if options.plots and found.problem.report.baseline and found.status == "planned":
                found = _compared(found, progress)
            if options.suggest and found.problem.report.suggest and progress.stop_signal is None:
                found = with_suggestions(found, progress)
            progress.planned(found)
            written = _write(found, folder, options, progress)
            progress.finish()
            code = codes.INTERNAL if written.error else exit_code(found, progress.stop_signal)
            _print(found, options, written, code)
    finally:
        folder.discard()
    return code


def _compared(found: Plan, progress: Progress) -> Plan:
    """The plan with its unconstrained baseline for the figures; without one if that fails: the plan itself is good."""

    def watch(_: str, iteration: Iteration | None) -> bool:
        return progress("baseline", iteration) if iteration else progress.stop_signal is not None

    progress("baseline", None)
    try:
        return with_baseline(found, watch)
    except Exception as error:
        progress.note(f"warning: the unconstrained baseline could not be planned ({type(error).__name__}: {error})")
        return found


def exit_code(found: Plan, stop_signal: int | None = None) -> int:
    """The exit code that a plan deserves."""
    if stop_signal is not None:
        return codes.of_signal(stop_signal)
    if found.status == "infeasible":
        return codes.NO_PLAN
    if found.status != "planned":
        return codes.LIMIT
    return codes.OK if found.verified else codes.NOT_VERIFIED


def _write(found: Plan, folder: ResultsFolder, options: RunOptions, progress: Progress) -> Written:
    """Write and place the results; without figures if they can't be drawn or the user wants to stop."""
    progress("write", None)
    error = ""
    try:
        write_results(found, folder.working, options.command)
        if progress.stop_signal is None:
            error = _draw(found, folder.working, options)
        placed = folder.commit()
    except OSError as reason:
        return Written(None, f"{folder.target}: the plan could not be written ({reason.strerror or reason})")
    return Written(placed, error and f"{placed}: the plan is saved, but its figures could not be drawn ({error})")


def _draw(found: Plan, folder: Path, options: RunOptions) -> str:
    """Draw what was asked for; returns why it failed, if it did: a plan is worth keeping without pictures."""
    from ensemble_ctrl.report.figures import write_figures

    try:
        if options.plots:
            write_figures(found.problem, found.controls, folder, found.baseline, found.details["routes"])
            write_report(found, folder / REPORT, folder)
        if options.animation is not None:
            found.animate(folder / f"animation.{options.animation}")
    except RunawayError:
        return ""  # nothing can be drawn of a fleet that leaves all bounds; the summary says so
    except Exception as error:
        for half_written in [*folder.glob("*.png"), folder / REPORT]:
            with suppress(OSError):
                half_written.unlink()
        return getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
    return ""


def _print(found: Plan, options: RunOptions, written: Written, code: int) -> None:
    """The result on stdout: the summary or one JSON object, with the controls themselves if no file holds them."""
    folder = None if written.folder is None else str(written.folder)
    try:
        say(_result(found, options, written, code), folder)
    finally:
        if written.error:
            complain(f"error: {written.error}")
        elif code in (codes.NO_PLAN, codes.NOT_VERIFIED):
            complain(f"error: {failure_message(found)}")


def _interrupted(found: Plan, code: int) -> str:
    """What an interruption after the search left out; empty without one, or where the plan's status says it."""
    if code not in (codes.INTERRUPTED, codes.TERMINATED) or found.status == "interrupted":
        return ""
    return "interrupted after the search ended; what was not yet made or drawn by then is missing"


def _result(found: Plan, options: RunOptions, written: Written, code: int) -> str:
    """The result as text."""
    folder, after = None if written.folder is None else str(written.folder), _interrupted(found, code)
    unwritten = found.controls.tolist() if folder is None else None
    if options.json:
        facts = {**summary(found), "exit_code": code, "folder": folder}
        facts |= {} if unwritten is None else {"controls": unwritten}
        facts |= {"interrupted": after} if after else {}
        return to_json({**facts, "message": written.error} if written.error else facts)
    head, *rows = summary_lines(found, folder)
    stopped = [f"  {'stopped':<11}{after}"] if after else []
    table = route_lines(found.details["routes"]) if options.verbose else []
    controls = [] if unwritten is None else ["controls, since no file holds them:", controls_csv(found).rstrip()]
    return "\n".join([head, *stopped, *rows, *table, *controls])
