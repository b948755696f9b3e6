"""``ensemble-plan widest``: the largest range of the parameter with a certified plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ensemble_ctrl.api.results import SCHEMA, to_json
from ensemble_ctrl.api.widening import Widest, widest, widest_box
from ensemble_ctrl.certificate import Certificate
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.plain import at_least
from ensemble_ctrl.files.config import read
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.report import conflict_text
from ensemble_ctrl.report.text import percent, ranges_text


def find_widest(
    config: str, overrides: list[str], tolerance: float, parameter: str | None, as_json: bool, quiet: bool
) -> int:
    """Search and print the answer; returns 0, or 3 if no range has a certified plan."""
    problem = read(config, overrides).problem
    name = parameter or next(iter(problem.fleet.names), "")

    def tell(tried: Interval, good: bool) -> None:
        if not quiet:
            complain(f"{name} {tried.lower:.4g}..{tried.upper:.4g}: {'certified' if good else 'no certified plan'}")

    found = widest(problem, tolerance, tell, parameter)
    code = codes.NO_PLAN if found.interval is None else codes.OK
    blocked = [conflict_text(c) for c in found.blocked[:3]]
    if as_json:
        say(to_json({"schema": SCHEMA, "name": problem.name, **_as_data(found), "exit_code": code}))
        return code
    if found.interval is None:
        say(
            f"{problem.name}: no certified plan for any range of {name} tried around "
            f"{problem.fleet.parameters[name].center:g}"
        )
    else:
        certificate = found.plan.certificate if found.plan else None
        say(f"{problem.name}: widest certified {name} {found.interval.lower:.4f}..{found.interval.upper:.4f}")
        if certificate is not None:
            say(f"  proven     {', '.join(_bounds(certificate))}")
    if found.beyond is not None:
        say(f"  beyond     {name} {found.beyond.lower:.4f}..{found.beyond.upper:.4f}: no certified plan was found")
        for text in blocked:
            say(f"  blocked    {text}")
    say(f"  tried      {found.tried} ranges; that no wider plan exists is not proven")
    return code


def find_widest_box(config: str, overrides: list[str], names: Sequence[str], as_json: bool, quiet: bool) -> int:
    """Search the box of two parameters with the largest area; returns 0, or 3 if none has a certified plan."""
    problem = read(config, overrides).problem

    def tell(tried: Fleet, good: bool) -> None:
        if not quiet:
            complain(f"{ranges_text(tried)}: {'certified' if good else 'no certified plan'}")

    found = widest_box(problem, tuple(names), tell=tell)  # type: ignore[arg-type]
    code = codes.NO_PLAN if found.plan is None else codes.OK
    if as_json:
        box = {name: _ends(interval) for name, interval in found.ranges.items()}
        facts = {"box": box, "curve": list(found.curve), "tried": found.tried, "exit_code": code}
        say(to_json({"schema": SCHEMA, "name": problem.name, **facts}))
        return code
    if found.plan is None:
        say(f"{problem.name}: no certified plan for any box of {' and '.join(names)} tried")
        return code
    certificate = found.plan.certificate
    say(f"{problem.name}: largest certified box {ranges_text(found.plan.problem.fleet)}")
    if certificate is not None:
        say(f"  proven     {', '.join(_bounds(certificate))}")
    for halves in found.curve:
        say(f"  half width {', '.join(f'{name} {half:.4f}' for name, half in halves.items())}: certified")
    say(f"  tried      {found.tried} boxes; that no larger one has a plan is not proven")
    return code


def _bounds(certificate: Certificate) -> Iterator[str]:
    """What is proven of the widest fleet."""
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
