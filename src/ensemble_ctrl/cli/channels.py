"""``ensemble-plan channels``: the fewest broadcast channels, each with a certified plan in a folder of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from ensemble_ctrl.api.channels import MOST, Channel, Channels, channels
from ensemble_ctrl.api.results import SCHEMA, to_json, write_results
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.progress import Progress, stoppable
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.plain import at_least
from ensemble_ctrl.core.storage import put_file
from ensemble_ctrl.files.config import read
from ensemble_ctrl.files.folder import ResultsFolder
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.report.text import member_text

ENDS = "stopping; nothing is kept"
"""What a signal does."""


@dataclass(frozen=True)
class ChannelOptions:
    """The options of one call, as given."""

    config: str
    output: Path | None = None
    overrides: tuple[str, ...] = ()
    at_most: int | None = None
    clearance: float = 0.0
    tolerance: float = 0.01
    json: bool = False
    quiet: bool = False
    plots: bool = True
    overwrite: bool = False
    command: tuple[str, ...] = ()


def find_channels(options: ChannelOptions) -> int:
    """Search, write every channel's plan, print the answer; returns 0, or 3 where the fleet could not be covered."""
    progress = Progress(options.quiet)
    problem = read(options.config, options.overrides).problem
    folder = ResultsFolder(options.output, f"{problem.name}-channels", options.overwrite)

    def tell(tried: Fleet, good: bool) -> None:
        if not options.quiet:
            complain(f"{_ranges_text(_ranges(tried))}: {'certified' if good else 'no certified plan'}")

    def quietly(_: str, __: object) -> bool:
        return progress.stop_signal is not None

    try:
        with stoppable(progress, folder.discard, ENDS):
            found = channels(
                problem,
                options.at_most,
                clearance=options.clearance,
                tolerance=options.tolerance,
                progress=quietly,
                tell=tell,
            )
            if progress.stop_signal is not None:
                return codes.of_signal(progress.stop_signal)
            placed = _write(problem, found, folder, options) if found.channels else None
    finally:
        folder.discard()
    code = codes.OK if found.channels else codes.NO_PLAN
    if options.json:
        facts = {**_as_data(problem, found), "exit_code": code, "folder": None if placed is None else str(placed)}
        say(to_json(facts), None if placed is None else str(placed))
    else:
        say("\n".join(_lines(problem, found, placed, options.at_most)), None if placed is None else str(placed))
    return code


def _write(problem: Problem, found: Channels, folder: ResultsFolder, options: ChannelOptions) -> Path:
    """Each channel's plan in a folder of its own, the facts of all, and the picture."""
    for k, channel in enumerate(found.channels):
        own = folder.working / name_of(k)
        own.mkdir()
        write_results(channel.plan, own, options.command)
    put_file(folder.working / "channels.json", to_json(_as_data(problem, found), indent=2) + "\n")
    if options.plots:
        from ensemble_ctrl.report.canvas import save
        from ensemble_ctrl.report.channels import draw_channels, draw_curve

        groups = [(channel.plan.problem, channel.plan.controls) for channel in found.channels]
        save(draw_channels(problem, groups), folder.working / "channels.png")
        if len(found.curve) > 1:
            points = [(point.channels, point.clearance) for point in found.curve]
            save(draw_curve(problem, points, found.lower_bound), folder.working / "curve.png")
    return folder.commit()


def name_of(k: int) -> str:
    """The folder of a channel's plan, counted from 0."""
    return f"channel-{k + 1}"


def _missed(found: Channels, at_most: int | None) -> str:
    """Why a part of the fleet is not covered."""
    if not found.limited:
        return "no certified plan was found"
    allowed = f"{MOST} channels, the most without --at-most" if at_most is None else f"--at-most {at_most}"
    return f"no channel was left of {allowed}"


def _lines(problem: Problem, found: Channels, placed: Path | None, at_most: int | None) -> Iterator[str]:
    """The answer as text."""
    if found.missed is not None:
        yield f"{problem.name}: the fleet could not be covered"
        yield f"  missed     {_ranges_text(found.missed)}: {_missed(found, at_most)}"
    else:
        count = len(found.channels)
        yield f"{problem.name}: {count} broadcast channel{'s' * (count != 1)}, each certified for its group"
        yield from (_line(k, channel) for k, channel in enumerate(found.channels))
    if found.missed is None or found.lower_bound > 1:
        yield f"  bound      {_bound_text(found)}"
    yield f"  tried      {found.tried} groups"
    for point in found.curve[1:]:
        yield f"  or         {point.channels} channels: clearance >= {at_least(point.clearance)} m"
    if placed is not None:
        several = " ..: a plan for each, to verify by itself" if len(found.channels) > 1 else ""
        yield f"  files      {placed}/{name_of(0)}{several}"


def _bound_text(found: Channels) -> str:
    """What is proven of how many channels are needed."""
    least = found.lower_bound
    if len(found.channels) == 1:
        return "one channel is the fewest"
    if least == 1:
        return "that no fewer channels are enough is not proven"
    members = "; ".join(member_text(member) for member in found.apart)
    ending = ", so no fewer are enough" if least == len(found.channels) else ""
    return f"at least {least} channels are needed{ending}: no two of these members can share one: {members}"


def _line(k: int, channel: Channel) -> str:
    """One channel."""
    robots = "" if channel.robots is None else f" ({channel.robots} robot{'s' * (channel.robots != 1)})"
    return f"  {name_of(k):<11}{_ranges_text(channel.ranges)}{robots}: {', '.join(_bounds(channel))}"


def _bounds(channel: Channel) -> Iterator[str]:
    """What is proven of a channel."""
    certificate = channel.plan.certificate
    if certificate is not None and certificate.clearances:
        yield f"clearance >= {at_least(certificate.clearance)} m"
    if certificate is not None and certificate.parts:
        yield f"robustness >= {at_least(certificate.robustness)} {certificate.unit}"


def _ranges(fleet: Fleet) -> dict[str, Interval]:
    """The range of each parameter."""
    return {name: Interval(distribution.lower, distribution.upper) for name, distribution in fleet.parameters.items()}


def _ranges_text(ranges: dict[str, Interval]) -> str:
    """Ranges of parameters in one line."""
    return (
        ", ".join(f"{name} {distribution.lower:.4f}..{distribution.upper:.4f}" for name, distribution in ranges.items())
        or "the fleet"
    )


def _ends(ranges: dict[str, Interval]) -> dict[str, Sequence[float]]:
    """Ranges as plain data."""
    return {name: [distribution.lower, distribution.upper] for name, distribution in ranges.items()}


def _as_data(problem: Problem, found: Channels) -> dict[str, object]:
    """The answer as plain data."""
    rows = [
        {
            "folder": name_of(k),
            "ranges": _ends(channel.ranges),
            "robots": channel.robots,
            "clearance": channel.clearance,
            "robustness": channel.plan.certificate.robustness if channel.plan.certificate else None,
            "proven": channel.plan.certificate.proven if channel.plan.certificate else None,
            "cost": channel.plan.details.get("cost"),
        }
        for k, channel in enumerate(found.channels)
    ]
    missed = None if found.missed is None else _ends(found.missed)
    curve = [{"channels": point.channels, "clearance": point.clearance} for point in found.curve]
    bound = {"lower_bound": found.lower_bound, "apart": list(found.apart)}
    facts = {"missed": missed, **bound, "tried": found.tried, "curve": curve}
    return {"schema": SCHEMA, "name": problem.name, "channels": rows, **facts}
