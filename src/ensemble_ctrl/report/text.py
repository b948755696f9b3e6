"""The summary that a person reads: about a dozen lines, all of it computed in this run or read from the plan."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import ceil, floor
from shlex import quote
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.core.plain import at_least
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.checks import coverage_text
from ensemble_ctrl.problem.ensemble import Ensemble
from ensemble_ctrl.problem.evaluation.conflicts import unit_of_task, units_of_parts
from ensemble_ctrl.problem.evaluation.sampled import Replay, ShareSeen
from ensemble_ctrl.problem.fleet import START_COLUMNS, START_PREFIX
from ensemble_ctrl.problem.specification import NOTHING_AVOIDED, NOTHING_REQUIRED
from ensemble_ctrl.problem.starts import label
from ensemble_ctrl.report.errors import errors_text, terrain_rows, tolerated
from ensemble_ctrl.report.tried import tried

if TYPE_CHECKING:
    from ensemble_ctrl.certificate import Certificate, TaskBound
    from ensemble_ctrl.problem.evaluation.conflicts import Conflict


class PlanLike(Protocol):
    """What a summary needs of a plan."""

    @property
    def problem(self) -> Problem:
        """The problem that was solved."""

    @property
    def status(self) -> str:
        """How the search ended."""

    @property
    def details(self) -> dict[str, Any]:
        """What the search did."""

    @property
    def controls(self) -> NDArray[np.float64]:
        """Broadcast commands, shape (steps, n_u)."""

    @property
    def replayed(self) -> Replay | None:
        """The replay, if any."""

    @property
    def certificate(self) -> Certificate | None:
        """What is proven, if a certificate was requested."""

    def conflicts(self) -> tuple[Conflict, ...]:
        """What fails."""


WIDTH = 120
"""Characters of a line."""
STATUS_WORDS = {
    "planned": "plan found",
    "infeasible": "NO PLAN FOUND (infeasible near every guess)",
    "limit": "limit reached, best plan so far",
    "interrupted": "interrupted, best plan so far",
}


def verdict(plan: PlanLike) -> str:
    """One line: what became of it."""
    words = STATUS_WORDS[plan.status]
    run = plan.replayed
    if plan.status == "infeasible" or run is None:
        return words
    bad = int(run.violating.sum())
    proof = ""
    if plan.certificate is not None and plan.certificate.empty:
        proof = "nothing is required, "
    elif plan.certificate is not None:
        proof = "proven for every member, " if plan.certificate.proven == "yes" else "NOT proven for every member, "
    if run.shares:
        proof = proof.replace("every member", "the share asked for")
        least = min(run.shares, key=lambda share: share.satisfied - share.required)
        few = "only " if bad else ""
        return f"{words}, {proof}{few}{percent(least.satisfied)} % of {run.members} members do it"
    return f"{words}, {proof}" + (
        f"no member of {run.members} violates" if not bad else f"{bad} of {run.members} members VIOLATE it"
    )


def summary_lines(plan: PlanLike, files: str | None = None) -> list[str]:
    """The summary, a line each."""
    rows = summary_rows(plan) + ([("files", files)] if files else [])
    return [f"{plan.problem.name}: {verdict(plan)}", *(line for row in rows for line in row_lines(*row))]


def row_lines(label: str, text: str) -> list[str]:
    """One row; what is proven and the task, which may be as long as they like, are wrapped."""
    long = label in ("task", "obstacles", "zones", "proven", "errors", "terrain")
    texts = wrap(text, WIDTH - 13, break_long_words=False) if long else [text]
    return [f"  {'' if i else label:<11}{text}" for i, text in enumerate(texts)]


def summary_rows(plan: PlanLike) -> list[tuple[str, str]]:
    """The summary as labels and texts."""
    problem, d = plan.problem, plan.details
    rows = [
        ("fleet", _fleet(problem)),
        *([("errors", errors_text(problem.fleet))] if problem.fleet.uncertainty else []),
        ("horizon", f"{problem.duration:g} s in {problem.steps} steps"),
        ("task", str(problem.task)),
        *([("obstacles", coverage_text(problem))] if problem.obstacles else []),
        *([("zones", "; ".join(f"{name}: {zone}" for name, zone in problem.zones.items()))] if problem.zones else []),
        *terrain_rows(problem, plan.controls),
        *minimum_time(d.get("minimum_time")),
        *tolerated(d.get("tolerance")),
        *measured(plan.replayed, unit_of_task(problem)),
    ]
    if plan.replayed is None or plan.replayed.violating.any() or plan.status == "infeasible":
        rows += [("violated", conflict_text(c)) for c in plan.conflicts()[:5]]
    if plan.status in ("infeasible", "limit"):
        rows += [("" if i else "tried", line) for i, line in enumerate(_wrapped(tried(d)))]
    if plan.status == "infeasible" or "suggestions" in d:
        rows += _suggested(d.get("suggestions", {}), problem)
    rows += proven(problem, plan.certificate)
    if d.keys() >= {"cost", "effort", "terminal"}:
        rows.append(("cost", _cost(d)))
    rows += [("risk", text) for text in _at_risk(d.get("at_risk", {}))]
    rows += [("arrival", text) for text in _arrival(d.get("arrival", {}))]
    if "minlp" in d:
        rows += _mixed(d["minlp"])
    if d.keys() >= {"seconds", "routes", "iterations", "build_seconds"}:
        rows.append(("work", _work(d)))
    return rows


def _wrapped(texts: Iterable[str]) -> Iterator[str]:
    """Lines of texts, each of which may be long."""
    return (line for text in texts for line in wrap(text, WIDTH - 13))


def _suggested(suggestions: dict[str, Any], problem: Problem) -> Iterator[tuple[str, str]]:
    """What would help, if that was searched for; what could, where nothing was found."""
    helps, failed = suggestions.get("helps", []), suggestions.get("failed", [])
    for i, found in enumerate(helps):
        yield ("" if i else "it works", f"{'or ' if i else ''}with {found['change']}: planned and proven")
        if found["set"]:
            yield "", " ".join(f"--set {quote(change)}" for change in found["set"])
    if failed:
        yield from (("", line) for line in wrap(f"no plan was found even with {'; '.join(failed)}", WIDTH - 13))
    if suggestions.get("limited"):
        yield "", f"the {suggestions['seconds']:.0f} s for this were up: other changes were not tried"
    if not helps:
        smaller = "smaller errors of the model (fleet.uncertainty), " if problem.fleet.uncertainty else ""
        smaller += "a way round the terrain, " if problem.terrain else ""
        text = (
            f"{smaller}a longer horizon, higher input bounds, reversing, a narrower parameter range, or wider passages"
        )
        yield from (("" if i else "try", line) for i, line in enumerate(_wrapped([text])))


def _fleet(problem: Problem) -> str:
    """Who moves, from where."""
    fleet, starts = problem.fleet.of_one_start, problem.fleet.starts
    headed = bool(fleet.system.heading_state)
    place = ", ".join(f"{value:g}" for value in (fleet.position if headed else fleet.start_place))
    turned = f" heading {np.degrees(fleet.heading):.4g} deg" if headed else ""
    if starts:
        turned += f" at {len(starts)} offsets ({short(', '.join(starts))})"
    return f"{fleet.system.name}, {ranges_text(fleet)}, {fleet.size_text}, from ({place}){turned}"


def ranges_text(fleet: Ensemble) -> str:
    """The parameters with their ranges; lengths and angles with their units."""
    if not fleet.names:
        return "all members equal"
    texts = (range_text(name, one.lower, one.upper, "to") for name, one in fleet.parameters.items())
    return ", ".join(f"{name} {text}" for name, text in zip(fleet.names, texts, strict=True))


def range_text(name: str, low: float, high: float, to: str) -> str:
    """A parameter's range with its unit, angles in degrees."""
    if name == "start_heading":
        return f"{np.degrees(low):.4g} {to} {np.degrees(high):.4g} deg"
    return f"{low:.4g} {to} {high:.4g}{unit_of(name)}"


def member_text(parameters: Mapping[str, float]) -> str:
    """One member by its parameters."""
    return ", ".join(f"{name} {value:.6g}{unit_of(name)}" for name, value in parameters.items()) or "any member"


def unit_of(name: str) -> str:
    """A parameter's unit, with a space before it."""
    return " rad" if name == "start_heading" else " m" if name in START_COLUMNS else ""


def short(text: str, most: int = 34) -> str:
    """A text of so many letters at most."""
    return text if len(text) <= most else text[: most - 1] + "…"


def literal(text: str) -> str:
    r"""A text for Matplotlib that shows its dollars, where else they would begin a formula.

    Examples
    --------
    >>> print(literal("$x^$"))
    \$x^\$
    """
    return text.replace("$", r"\$")


def parameter_label(problem: Problem, name: str) -> str:
    """A parameter and its unit for an axis, where the system gives one."""
    fleet = problem.fleet
    units = fleet.state_units | dict.fromkeys(fleet.system.factors, "-") | dict(fleet.system.parameter_units)
    unit = unit_of(name).strip() or units.get(name.removeprefix(START_PREFIX), "SI units")
    return f"{name} [{unit}]"


def measured(run: Replay | None, unit: str = "m") -> list[tuple[str, str]]:
    """What the replay found; the task's robustness is in `unit`."""
    if run is None:
        return []
    value, worst = run.worst
    who = "of the task, shares as asked" if run.shares else f"for the worst member ({member_text(worst)})"
    who = label(who, run.worst_start)
    rows = [("robustness", NOTHING_REQUIRED if value == np.inf else f"{value:.4f} {unit} {who}")]
    c = min(run.clearances, key=lambda c: c.distance, default=None)
    if c is None or not np.isfinite(c.distance):
        rows.append(("clearance", NOTHING_AVOIDED))
    else:
        rows.append(
            (
                "clearance",
                f"{c.distance:.4f} m to {c.obstacle} at t = {c.time:.2f} s ({member_text(c.parameters)})",
            )
        )
    bad = int(run.violating.sum())
    if run.shares:
        rows += [("replay", f"{_looks(run)}: {_seen(share)}") for share in run.shares]
        return rows
    rows.append(
        (
            "replay",
            f"{_looks(run)}: {bad} violate, {percent(run.satisfied)} % satisfy{_share(run)}",
        )
    )
    return rows


def _looks(run: Replay) -> str:
    """How many members were looked at, how often, and whether they were disturbed."""
    members = f"{run.members} members{', each with a sampled disturbance' if run.disturbed else ''}"
    return f"{members}, {run.substeps} sample{'s' if run.substeps > 1 else ''} per step"


def minimum_time(found: dict[str, Any] | None) -> list[tuple[str, str]]:
    """How short the time is that was to be as short as possible, and what is known of shorter ones."""
    if found is None:
        return []
    missed = "" if found["missed"] is None else f"; none found for {found['missed']:.3f} s"
    return [("minimum", f"{found['of']} {found['value']:.3f} s{missed}; none exists below {found['bound']:.3f} s")]


def _seen(share: ShareSeen) -> str:
    """The share that does a part, and its interval for the whole fleet."""
    bounds = f"({percent(share.low)} to {percent(share.high, up=True)} % of all, 95 % confidence)"
    return f"{percent(share.satisfied)} % do what {100 * share.required:g} % have to {bounds}"


def _share(run: Replay) -> str:
    """The interval for the whole fleet from the drawn members, if any were drawn."""
    low, _ = run.share()
    return f" (>= {percent(low)} % of all, 95 % confidence)" if run.corners < run.members else ""


def conflict_text(c: Conflict) -> str:
    """One violated constraint, with amount, parameter and time; a state that runs away is reported with all of that."""
    if not np.isfinite(c.amount):
        return c.what
    return f"{c.what} by {c.amount:.3g} {c.unit} ({member_text(c.parameters)}, t = {c.time:.2f} s)"


def proven(problem: Problem, certificate: Certificate | None) -> list[tuple[str, str]]:
    """What holds for every parameter and every instant."""
    if certificate is None:
        return [("proven", "nothing for all parameters (no certificate was asked for)")]
    c = certificate
    if c.reason:
        return [("proven", f"UNDECIDED: {c.reason}")]
    if c.empty:
        return [("proven", NOTHING_REQUIRED)]
    units = units_of_parts(problem)
    ranges = [f"{name} {low:.4g}..{high:.4g}" for name, (low, high) in c.ranges.items()]
    bounds = ["every disturbance within the bounds"] if c.uncertainty else []
    scope = ", ".join([*(f"every {text}" for text in ranges[:1]), *ranges[1:], "every instant", *bounds])
    claims = [f"clearance >= {at_least(c.clearance)} m"] if c.clearances else []
    rest = min((b.proven for b in c.parts if b.share is None), default=None)
    unit = unit_of_task(problem)
    claims += [] if rest is None else [f"rest of the task >= {at_least(rest)} {unit}"]
    texts = [f"for {scope}: {', '.join(claims)}"] if claims else []
    texts += [_proven_share(b, units.get(b.part, "m")) for b in c.parts if b.share is not None]
    if c.counter_example is not None:
        found = c.counter_example
        when = "" if found.time is None else f" at t = {found.time:.2f} s"
        who = member_text(found.parameters) if found.parameters or not c.ranges else "the fleet"
        return [("proven", f"NO: {who} violates {found.what} by {found.amount:.3g} {units.get(found.what, 'm')}{when}")]
    if c.proven != "yes":
        texts = [f"UNDECIDED {text.replace(': ', ': only ', 1)}" for text in texts]
    texts[-1] += f" ({c.seconds:.2f} s)"
    return [("" if i else "proven", text) for i, text in enumerate(texts)]


def _proven_share(bound: TaskBound, unit: str) -> str:
    """What a share of the fleet does, the share in percent and rounded down."""
    share = percent(bound.share or 0.0, decimals=2)
    return f"for {share} % of the fleet, every instant: their part of the task >= {at_least(bound.proven)} {unit}"


def percent(share: float, up: bool = False, decimals: int = 3) -> str:
    """A share in percent, rounded down or up: never 100 while one member is missing.

    >>> percent(1.0), percent(0.999999), percent(0.95139), percent(0.94701, up=True)
    ('100', '99.999', '95.139', '94.701')
    """
    scaled = round(10 ** (2 + decimals) * share, 6)
    return f"{(ceil(scaled) if up else floor(scaled)) / 10**decimals:.{3 + decimals}g}"


def _cost(d: dict[str, Any]) -> str:
    """The cost and its parts."""
    risk = d.get("risk", 0.0)
    return (
        f"{d['cost']:.4f} = effort {d['effort']:.4f} + terminal {d['terminal']:.4f}"
        + (f" + risk {risk:.4f}" if risk else "")
        + f" - weighted robustness {d['effort'] + d['terminal'] + risk - d['cost']:.4f}"
    )


def _mixed(m: dict[str, Any]) -> list[tuple[str, str]]:
    """What choosing facets anew did to the cost, and what the solver's gap is worth."""
    kept = [f"{r['cost']:.4f} ({r['name']})" for r in m["rounds"] if r["kept"] and r["cost"] is not None]
    steps = " -> ".join([f"{m['nlp_cost']:.4f} (nlp)", *kept])
    nothing = "" if kept else ", nothing better was found"
    bonmin, solver = [r for r in m["rounds"] if r["switches"]], m.get("solver", "Bonmin")
    nodes = f", {m['nodes']} nodes" if solver == "Bonmin" else ""
    rows = [("minlp", f"cost {steps}{nothing}; {len(bonmin)} run{'s' * (len(bonmin) != 1)} of {solver}{nodes}")]
    for r in (r for r in bonmin if r["status"] not in ("solved", "infeasible")):
        rows.append(("", f"{r['name']}: {r['message']}"))
    gaps = [f"{100 * r['gap']:.2g} % ({r['name']})" for r in bonmin if r["gap"] is not None]
    lead = f"{solver}'s gap: {', '.join(gaps)}; it" if gaps else "This"
    rows.append(("", f"{lead} is no proof of optimality: the problem is not convex, and only some facets were offered"))
    return rows


def _at_risk(found: dict[str, Any]) -> Iterator[str]:
    """How the worst part of the fleet does, in what is penalised."""
    if found:
        sign, what = (1.0, "distance from the target") if found["of"] == "terminal" else (-1.0, "clearance")
        worst = f"{100 * (1 - found['level']):.4g} %"
        yield f"{what} of the worst {worst}: {sign * found['cvar']:.4f} m on average, {_limit(found, sign)}"


def _limit(found: dict[str, Any], sign: float) -> str:
    """The value at risk."""
    return f"{'at least' if sign > 0 else 'at most'} {sign * found['value_at_risk']:.4f} m"


def _arrival(found: dict[str, Any]) -> Iterator[str]:
    """How close the fleet comes to its target."""
    if "rms" in found:
        yield f"{found['rms']:.4f} m RMS from the target, {found['largest']:.4f} m at most"
    elif "distance" in found:
        deviations = " by ".join(f"{row[k] ** 0.5:.3f} m" for k, row in enumerate(found["covariance"]))
        spread = f"mean {_place(found['mean'], 3)}, deviation {deviations}"
        yield f"{spread}; {found['distance']:.4f} m from the target distribution"
    elif "moments" in found:
        yield "moments " + ", ".join(_place(moment, 4) for moment in found["moments"])


def _place(numbers: Sequence[float], digits: int) -> str:
    """A place or a moment, ``(1.00, 2.00)``."""
    return f"({', '.join(f'{number:.{digits}f}' for number in numbers)})"


def _work(d: dict[str, Any]) -> str:
    """What it took."""
    times = ", ".join(f"{name} {value:.2f} s" for name, value in d["seconds"].items())
    count = len(d["routes"])
    return f"{count} route{'s' * (count != 1)}, {d['iterations']} iterations, build {d['build_seconds']:.2f} s; {times}"
