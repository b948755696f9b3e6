"""``ensemble-plan verify``: check a saved plan from its files alone."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.api.results import SCHEMA, controls_csv, planned, replay_summary, to_json
from ensemble_ctrl.certificate import EFFORT, Certificate, as_data, differences
from ensemble_ctrl.certificate.record import claims_each
from ensemble_ctrl.cli import codes
from ensemble_ctrl.cli.root import UsageError
from ensemble_ctrl.cli.streams import complain, say
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError, RunawayError
from ensemble_ctrl.core.storage import read_regular
from ensemble_ctrl.files.config import dump, load
from ensemble_ctrl.files.planfile import MOST_BYTES
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.problem.bounds import Beyond, beyond_bounds
from ensemble_ctrl.problem.evaluation.conflicts import unit_of_task
from ensemble_ctrl.problem.evaluation.sampled import Replay
from ensemble_ctrl.report.text import measured, proven, row_lines

HEADS = {"yes": "proven", "no": "REFUTED", "undecided": "NOT PROVEN"}
"""Verdicts in the first line."""
MOST_MEMBERS = 10_000_000
"""Members that are replayed here, at most: their numbers are kept, 16 bytes and more of each."""


@dataclass(frozen=True, eq=False)
class Verified:
    """What the check found."""

    plan: Plan
    certificate: Certificate
    run: Replay | None
    tampered: tuple[str, ...]
    requested: bool
    beyond: Beyond | None
    ignore_bounds: bool
    runaway: str = ""

    @property
    def good(self) -> bool:
        """Whether the plan is proven, no replayed member violates it, it keeps its bounds, and its files agree."""
        replayed = not self.runaway and (self.run is None or not self.run.violating.any())
        kept = self.ignore_bounds or self.beyond is None
        return self.certificate.proven == "yes" and replayed and kept and not self.tampered


def verify_plan(
    path: Path,
    requested: Sequence[str],
    members: int | None,
    as_json: bool,
    ignore_bounds: bool = False,
    each: bool = False,
) -> int:
    """Print what is proven; returns 0 if all is well, else 4."""
    if members is not None and members > MOST_MEMBERS:
        wanted = f"at most {MOST_MEMBERS} members, each of which is kept"
        raise UsageError(f"--members: expected {wanted}, got {members}; use ensemble-plan replay {path} for more")
    plan = read_plan(path)
    ranges = dict(_range(text, plan) for text in requested)
    claim = (path if path.is_dir() else path.parent) / "certificate.json"
    refined = claim.exists() and claims_each(_read_json(claim))
    certificate = plan.certify(ranges, each=each or refined)
    run, runaway = None, ""
    try:
        run = _replayed(plan, ranges, members) if members else None
    except RunawayError as error:
        runaway = error.what
    # a file is compared with bounds as refined as its own
    compared = certificate if refined or not each else plan.certify(ranges)
    tampered = () if requested else tuple(_disagreements(path, plan, compared))
    beyond = beyond_bounds(plan.problem, plan.controls)
    found = Verified(plan, certificate, run, tampered, bool(requested), beyond, ignore_bounds, runaway)
    code = codes.OK if found.good else codes.NOT_VERIFIED
    if as_json:
        say(to_json(_as_data(found, code)))
    else:
        say("\n".join(_lines(found)))
    for text in tampered:
        complain(f"error: {path}: {text}")
    return code


def read_plan(path: Path) -> Plan:
    """A plan from ``plan.npz``, or from ``controls.csv`` and ``problem.yaml`` in one folder."""
    table, problem = path / "controls.csv", path / "problem.yaml"
    if not path.is_dir() or (path / "plan.npz").exists():
        return Plan.load(path)
    if table.exists() and problem.exists():
        return Plan(load(problem), _read_csv(table), "planned")
    raise ProblemError(f"{path.resolve()}: expected plan.npz, or controls.csv and problem.yaml, in this folder")


def _read_csv(path: Path) -> Any:
    """The commands in a table as `controls_csv` writes it."""
    try:
        rows = np.loadtxt(StringIO(_text(path)), delimiter=",", skiprows=1, ndmin=2)
    except ValueError as error:
        raise ProblemError(f"{path}: expected a header and rows of numbers ({error})") from None
    return rows[:, 1:]


def _range(requested: str, plan: Plan) -> tuple[str, Interval]:
    """``traction=0.85:1.15`` as a name and an interval."""
    names = plan.problem.fleet.names
    name, _, values = (part.strip() for part in requested.partition("="))
    low, _, high = values.partition(":")
    if name not in names:
        raise ProblemError(f"--range {requested}: expected {' or '.join(f'{n}=LOW:HIGH' for n in names)}")
    try:
        return name, Interval(float(low), float(high))
    except ValueError as error:
        raise ProblemError(
            f"--range {requested}: expected {name}=LOW:HIGH with numbers LOW <= HIGH ({error})"
        ) from None


def _replayed(plan: Plan, ranges: Mapping[str, Interval], members: int) -> Replay:
    """About `members` members of the ranges, their ends included: evenly spread, or drawn from other distributions."""
    fleet = replace(plan.problem.fleet, parameters={**plan.problem.fleet.parameters, **ranges})
    if all(isinstance(distribution, Interval) for distribution in fleet.parameters.values()):
        return plan.replay(parameters=fleet.grid(members))
    drawn = fleet.sample(max(members - len(fleet.corners), 0), 0)
    return plan.replay(parameters=np.concatenate([fleet.corners, drawn])[:members])


def _disagreements(path: Path, plan: Plan, certificate: Certificate) -> list[str]:
    """How the files of a results folder contradict each other, or the certificate computed again."""
    folder = path if path.is_dir() else path.parent
    found = []
    table, problem, claim = folder / "controls.csv", folder / "problem.yaml", folder / "certificate.json"
    if table.exists() and _cells(_text(table)) != _cells(controls_csv(plan)):
        found.append("controls.csv holds other controls than plan.npz")
    if problem.exists() and dump(load(problem)) != dump(plan.problem):
        found.append("problem.yaml is another problem than the one in plan.npz")
    if claim.exists():
        found += [f"certificate.json: {text}" for text in differences(_read_json(claim), certificate)]
    if (facts := folder / "summary.json").exists():
        found += [f"summary.json: {text}" for text in _of_summary(_read_json(facts), plan, certificate)]
    return found


def _cells(table: str) -> list[list[str]]:
    """The cells of a table, with times in whole nanoseconds, as older tables have every digit of them."""
    rows = [line.split(",") for line in table.splitlines()]
    return [[_rounded(first), *rest] for first, *rest in rows]


def _rounded(cell: str) -> str:
    """A time in whole nanoseconds; what is none, as it is."""
    try:
        return repr(round(float(cell), 9))
    except ValueError:
        return cell


def _of_summary(summary: Any, plan: Plan, certificate: Certificate) -> Iterator[str]:
    """How a summary contradicts the plan or what is proven of it; what was replayed isn't looked at."""
    summary = summary if isinstance(summary, dict) else {}
    for name, value in planned(plan.problem).items():
        if summary.get(name) != value:
            yield f"it says {name} {summary.get(name)!r:.60}, the plan {value!r:.60}"
    claimed = summary.get("certificate")
    if isinstance(claimed, dict):
        claimed = {name: value for name, value in claimed.items() if name not in EFFORT}
    if claimed is not None:
        yield from differences(claimed, certificate)
    if summary.get("verified") is not False and plan.problem.verify.certificate and certificate.proven != "yes":
        yield f"it says verified {summary.get('verified')!r:.60}, computed again: {certificate.proven}"


def _text(path: Path) -> str:
    """What is in a file of the folder."""
    return read_regular(path, MOST_BYTES).decode("utf-8", "replace")


def _read_json(path: Path) -> Any:
    """What a JSON file says; one that can't be read claims nothing."""
    try:
        return json.loads(_text(path), object_pairs_hook=_once)
    except (ValueError, RecursionError):
        return None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object, none of whose entries stands there twice: readers differ in which one they take."""
    if len(dict(pairs)) < len(pairs):
        raise ValueError("an entry stands there twice")
    return dict(pairs)


def _lines(found: Verified) -> list[str]:
    """The result as text."""
    problem = found.plan.problem
    head = "nothing is required" if found.certificate.empty else HEADS[found.certificate.proven]
    if found.tampered:
        head = f"FILES DISAGREE; from the commands in plan.npz: {head}"
    if found.beyond is not None and not found.ignore_bounds:
        head += f", but beyond the {found.beyond.bounds} bounds at t = {found.beyond.time:g} s"
    agree = "agree with each other and with the proof"
    rows = [*proven(problem, found.certificate), *measured(found.run, unit_of_task(problem))]
    rows += [("replay", found.runaway)] if found.runaway else []
    if found.beyond is not None:
        rows.append(("bounds", f"{found.beyond}{' (ignored)' if found.ignore_bounds else ''}"))
    rows += [("files", "DISAGREE, see below" if found.tampered else agree)] if not found.requested else []
    rows += [("inputs", f"sha256 {found.certificate.inputs}")]
    return [f"{problem.name}: {head}", *(line for row in rows for line in row_lines(*row))]


def _as_data(found: Verified, code: int) -> dict[str, Any]:
    """The result as plain data."""
    return {
        "schema": SCHEMA,
        "name": found.plan.problem.name,
        "verified": found.good,
        "certificate": as_data(found.certificate),
        "replay": None if found.run is None else replay_summary(found.run, unit_of_task(found.plan.problem)),
        "runs_away": found.runaway or None,
        "beyond_bounds": None if found.beyond is None else asdict(found.beyond),
        "tampered": list(found.tampered),
        "exit_code": code,
    }


__all__ = ["Verified", "read_plan", "verify_plan"]
