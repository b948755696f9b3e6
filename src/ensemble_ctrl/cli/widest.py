"""``ensemble-plan widest``: the largest range of a parameter, or box of two, with a certified plan."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import SCHEMA, to_json, write_results
from ensemble_ctrl.api.widening import Widest, WidestBox, widest, widest_box
from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.root import naming
from ensemble_ctrl.cli.streams import say
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.plain import at_least
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config import read
from ensemble_ctrl.files.folder import ResultsFolder
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.report import conflict_text
from ensemble_ctrl.report.text import percent, ranges_text

PROMISE = "stopping; what is proven so far is printed"
"""What the first signal does."""
TOLERANCE = 0.01
"""Of the half width, in units of the parameter."""


@dataclass(frozen=True)
class WidestOptions:
    """The options of one search, as given."""

    config: str
    output: Path | None = None
    overrides: tuple[str, ...] = ()
    tolerance: float = TOLERANCE
    parameter: str | None = None
    box: tuple[str, ...] = ()
    json: bool = False
    quiet: bool = False
    overwrite: bool = False
    command: tuple[str, ...] = ()


def find_widest(options: WidestOptions) -> int:
    """Search, write the plan if a folder is given, print the answer.

    Returns
    -------
    int
        0; 3 if no range has a certified plan; that of a signal, with what was proven until it came.
    """
    progress = Progress(options.quiet)
    problem = read(options.config, options.overrides).problem
    folder = None if options.output is None else ResultsFolder(options.output, problem.name, options.overwrite)
    search = _box if options.box else _range
    try:
        with stoppable(progress, lambda: None if folder is None else folder.discard(), PROMISE):
            answer = search(problem, options, progress)
            placed = None if folder is None or answer.plan is None else _write(answer, folder, options)
    finally:
        if folder is not None:
            folder.discard()
    code = codes.NO_PLAN if answer.plan is None else codes.OK
    code = code if progress.stop_signal is None else codes.of_signal(progress.stop_signal)
    where = None if placed is None else str(placed)
    if options.json:
        say(
            to_json({"schema": SCHEMA, "name": problem.name, **answer.facts, "exit_code": code, "folder": where}), where
        )
        return code
    stopped = ["  stopped    before its end: a wider one may have a plan"] if progress.stop_signal is not None else []
    written = [] if placed is None else [f"  files      {placed}"]
    say("\n".join([*answer.lines, *stopped, *written]), where)
    return code


@dataclass(frozen=True, eq=False)
class _Answer:
    """What was found, in words and as data, and the picture that goes with the plan."""

    plan: Plan | None
    lines: list[str]
    facts: dict[str, object]
    box: WidestBox | None = None


def _write(answer: _Answer, folder: ResultsFolder, options: WidestOptions) -> Path:
    """The plan as `run` writes it, with the answer, and the picture of a box's curve."""
    assert answer.plan is not None
    write_results(answer.plan, folder.working, options.command)
    put_file(folder.working / "widest.json", to_json({"schema": SCHEMA, **answer.facts}, indent=2) + "\n")
    halves = {} if answer.box is None else {name: own.half_width for name, own in answer.box.ranges.items()}
    if answer.box is not None and all(halves.values()):
        from ensemble_ctrl.report.boxes import draw_boxes
        from ensemble_ctrl.report.canvas import save

        save(draw_boxes(answer.plan.problem, answer.box.curve, halves), folder.working / "box.png")
    return folder.commit()


def _range(problem: Problem, options: WidestOptions, progress: Progress) -> _Answer:
    """The widest range of one parameter."""
    name = options.parameter or next(iter(problem.fleet.names), "")

    def tell(tried: Interval, good: bool) -> None:
        progress.note(f"{name} {tried.lower:.4g}..{tried.upper:.4g}: {_outcome(good)}")

    with naming(parameter="--parameter"):
        found = widest(
            problem, options.tolerance, tell, options.parameter, stop=lambda: progress.stop_signal is not None
        )
    lines = list(_range_lines(problem, name, found))
    return _Answer(found.plan, lines, _as_data(found))


def _range_lines(problem: Problem, name: str, found: Widest) -> Iterator[str]:
    """The answer as text."""
    if found.interval is None or found.plan is None:
        around = f"{problem.fleet.parameters[name].center:g}"
        yield f"{problem.name}: no certified plan for any range of {name} tried around {around}"
    else:
        yield f"{problem.name}: widest certified {name} {found.interval.lower:.4f}..{found.interval.upper:.4f}"
        yield from _proven(found.plan.certificate)
    if found.beyond is not None:
        yield f"  beyond     {name} {found.beyond.lower:.4f}..{found.beyond.upper:.4f}: no certified plan was found"
        yield from (f"  blocked    {conflict_text(c)}" for c in found.blocked[:3])
    yield f"  tried      {found.tried} ranges; that no wider plan exists is not proven"


def _box(problem: Problem, options: WidestOptions, progress: Progress) -> _Answer:
    """The box of two parameters with the largest area."""

    def tell(tried: Fleet, good: bool) -> None:
        progress.note(f"{ranges_text(tried)}: {_outcome(good)}")

    with naming(parameters="--box"):
        found = widest_box(problem, options.box, tell=tell, stop=lambda: progress.stop_signal is not None)
    box = {name: _ends(interval) for name, interval in found.ranges.items()}
    facts = {"box": box, "curve": list(found.curve), "tried": found.tried}
    return _Answer(found.plan, list(_box_lines(problem, options, found)), facts, found)


def _box_lines(problem: Problem, options: WidestOptions, found: WidestBox) -> Iterator[str]:
    """The answer as text."""
    if found.plan is None:
        yield f"{problem.name}: no certified plan for any box of {' and '.join(options.box)} tried"
        return
    yield f"{problem.name}: largest certified box {ranges_text(found.plan.problem.fleet)}"
    yield from _proven(found.plan.certificate)
    for halves in found.curve:
        yield f"  half width {', '.join(f'{name} {half:.4f}' for name, half in halves.items())}: certified"
    yield f"  tried      {found.tried} boxes; that no larger one has a plan is not proven"


def _outcome(good: bool) -> str:
    """What came of a try."""
    return "certified" if good else "no certified plan"


def _proven(certificate: Certificate | None) -> Iterator[str]:
    """What is proven of the widest fleet."""
    if certificate is not None:
        yield f"  proven     {', '.join(_bounds(certificate))}"


def _bounds(certificate: Certificate) -> Iterator[str]:
    """The bounds of a certificate."""
    if certificate.clearances:
        yield f"clearance >= {at_least(certificate.clearance)} m"
    if certificate.parts:
        yield f"robustness >= {at_least(certificate.robustness)} {certificate.unit}"
    for part in certificate.parts:
        if part.share is not None:
            yield f"by >= {percent(part.share, decimals=2)} % of the fleet"


def _as_data(found: Widest) -> dict[str, object]:
    """The answer as plain data."""
    return {
        "widest": _ends(found.interval),
        "beyond": _ends(found.beyond),
        "blocked": [vars(c) for c in found.blocked],
        "tried": found.tried,
    }


def _ends(interval: Interval | None) -> list[float] | None:
    """A range as plain data."""
    return None if interval is None else [interval.lower, interval.upper]
