"""``ensemble-plan replay``: run a saved plan on as many members as one likes, in bounded memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from math import inf, isfinite
from pathlib import Path

from ensemble_ctrl.api.blocks import Draw, replay_on
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.root import UsageError, naming
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import first_of
from ensemble_ctrl.files.folder import require_free, write_text
from ensemble_ctrl.problem.evaluation.conflicts import unit_of_task
from ensemble_ctrl.problem.evaluation.streaming import SIZE
from ensemble_ctrl.problem.evaluation.summary import ShareCount, Summary
from ensemble_ctrl.problem.specification import NOTHING_AVOIDED, NOTHING_REQUIRED
from ensemble_ctrl.report.text import member_text, percent

STOPPING = "stopping after this block; the members run so far are kept"
CLOSEST = 3
"""Obstacles and worst members that the text names."""


@dataclass(frozen=True)
class ReplayOptions:
    """The options of one call, as given."""

    plan: Path
    members: int = 1_000_000
    substeps: int | None = None
    seed: int | None = None
    block: int = SIZE
    output: Path | None = None
    json: bool = False
    quiet: bool = False
    overwrite: bool = False
    cluster: str | None = None
    checkpoint: Path | None = None


def count(option: str, text: str) -> int:
    """A whole number as one writes it: 1000000, 1e6 or 1_000_000.

    Examples
    --------
    >>> count("--members", "1e8"), count("--members", "2.5e3"), count("--members", "1_000")
    (100000000, 2500, 1000)
    """
    try:
        value = float(text)
    except ValueError:
        value = inf
    if not 1 <= value < 1e15 or value != int(value):
        raise UsageError(f"{option}: expected a whole number from 1 on, such as 1000000 or 1e6, got {text!r}")
    return int(value)


def replay_plan(options: ReplayOptions) -> int:
    """Replay, print the summary, and write it if that is wanted; returns the exit code."""
    if options.output is not None:
        require_free(options.output, options.overwrite)
    plan, progress, began = Plan.load(options.plan), Progress(options.quiet), time.perf_counter()
    lost: list[str] = []
    with stoppable(progress, lambda: None, STOPPING):
        found = _run(plan, options, progress, began, lost)
    progress.finish()
    seconds = time.perf_counter() - began
    code = codes.OK if found.good else codes.NOT_VERIFIED
    if found.members < options.members:
        code = codes.INTERNAL if lost and progress.stop_signal is None else codes.of_signal(progress.stop_signal)
    data = {
        "schema": SCHEMA,
        "name": plan.problem.name,
        **found.as_data(),
        "disturbed": plan.problem.uncertain,
        "mean": found.mean,
        "variance": found.variance,
        "share_95": list(found.share()),
        "wanted_members": options.members,
        "left_out": lost,
        "seconds": seconds,
        "exit_code": code,
    }
    if options.output is not None:
        write_text(options.output, to_json(data) + "\n", options.overwrite)
    say(to_json(data) if options.json else "\n".join(_lines(plan, found, options, seconds)))
    for line in first_of(lost):
        complain(f"error: {line}")
    return code


def _run(plan: Plan, options: ReplayOptions, progress: Progress, began: float, lost: list[str]) -> Summary:
    """All members, or those until a signal asks to stop; blocks that could not be run are named in `lost`."""

    def watch(so_far: Summary) -> bool:
        rate = so_far.members * plan.problem.steps * so_far.substeps / (time.perf_counter() - began)
        done = f"{100 * so_far.members / options.members:.0f} % of {options.members:.4g} members"
        progress.passing(f"replay: {done}, {so_far.violating} violate, {rate:.2g} robot-steps/s")
        return progress.stop_signal is not None

    progress("replay", None)
    if options.cluster is None and options.checkpoint is None:
        return plan.replay_blocks(
            options.members, seed=options.seed, substeps=options.substeps, block=options.block, watch=watch
        )
    with naming(cluster="--cluster"):
        return replay_on(
            plan.problem,
            plan.controls,
            Draw(options.members, options.seed, options.substeps, options.block),
            options.cluster or "local",
            checkpoint=options.checkpoint,
            watch=watch,
            stop=lambda: progress.stop_signal is not None,
            left_out=lambda outcome: lost.append(outcome.failure),
        )


def _lines(plan: Plan, found: Summary, options: ReplayOptions, seconds: float) -> Iterator[str]:
    """The summary as text."""
    unit = unit_of_task(plan.problem)
    bad = f"{found.violating} of {found.members} members VIOLATE" if found.violating else ""
    ended = "" if found.members == options.members else f"ENDED after {found.members} of {options.members} members; "
    yield f"{plan.problem.name}: {ended}{bad or f'no member of {found.members} violates'}"
    rate = found.members * plan.problem.steps * found.substeps / seconds
    samples = f"{found.substeps} sample{'s' if found.substeps > 1 else ''} per step"
    rows = [("replay", f"{plan.problem.steps} steps, {samples}, {seconds:.1f} s ({rate:.2g} robot-steps/s)")]
    if plan.problem.uncertain:
        rows.append(("", "each member with one disturbance, sampled within the bounds"))
    rows += [("share", f"{_percent(found.share())} of the fleet satisfies (95 %)")]
    rows += [("", text) for text in map(_share, found.shares)]
    rows += list(_robustness(found, unit))
    rows += list(_clearances(found))
    yield from (f"  {label:<11}{text}" for label, text in rows)


def _robustness(found: Summary, unit: str) -> Iterator[tuple[str, str]]:
    """Mean and deviation, and the worst members."""
    if not found.finite:
        yield "robustness", NOTHING_REQUIRED
        return
    median = sum(found.histograms[0].quantile(0.5)) / 2
    yield "robustness", f"mean {found.mean:.4f}, deviation {found.variance**0.5:.4f}, median {median:.4f} {unit}"
    for k, one in enumerate(found.worst[:CLOSEST]):
        yield "" if k else "worst", f"{one.robustness:.6f} {unit} ({member_text(found.named(one))})"


def _clearances(found: Summary) -> Iterator[tuple[str, str]]:
    """The closest approaches."""
    near = sorted((c for c in found.clearances if isfinite(c.distance)), key=lambda c: c.distance)[:CLOSEST]
    for k, c in enumerate(near):
        inside = f", {c.inside} inside" if c.inside else ""
        where = f"to {c.obstacle} at t = {c.time:.2f} s ({member_text(c.parameters)}){inside}"
        yield "" if k else "clearance", f"{c.distance:.6f} m {where}"
    if not near:
        yield "clearance", NOTHING_AVOIDED


def _share(share: ShareCount) -> str:
    """What a share of the fleet has to do."""
    verdict = "reached" if share.reached else "NOT reached"
    return f"{_percent(share.interval)} do {share.part} (95 %), required {100 * share.required:g} %: {verdict}"


def _percent(ends: tuple[float, float]) -> str:
    """An interval of a share, rounded outwards."""
    low, high = ends
    return f"{percent(low, decimals=7)} to {percent(high, up=True, decimals=7)} %"
