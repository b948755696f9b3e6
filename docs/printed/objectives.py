"""What objectives and targets lead to: shares of the fleet, risk, and the shapes that one control can reach."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import ensemble_ctrl as ec
from ensemble_ctrl.problem.evaluation.arrival import risk
from ensemble_ctrl.problem.evaluation.sampled import trajectories
from printed.table import Row, Rows, Table, header, load, metres, proven_plan

LENGTHS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0)
MIDDLE, ALONG, ACROSS = np.array([6.5, 5.5]), np.array([0.8, 0.6]), np.array([-0.6, 0.8])
"""Of a line of robots: its middle, the way from the start to it, and the direction across, metres."""


def share_rows(problems: tuple[str, ...]) -> Rows:
    """A share of the fleet, and everybody."""
    problem = load(problems[0])
    (part,) = [problem.task]
    everybody = problem.with_(task=part.child)  # type: ignore[attr-defined]
    found = []
    for one in (problem, everybody):
        plan = proven_plan(one)
        assert plan.certificate is not None
        proven = min((bound.share for bound in plan.certificate.parts if bound.share is not None), default=1.0)
        found.append({"task": str(one.task), "cost": plan.details["cost"], "proven": proven})
    return found


def share_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header("task", "cost", "proven")
    for row in rows:
        proven = "everybody" if row["proven"] == 1.0 else f"{100 * row['proven']:.1f} % of the fleet"
        yield f"| `{row['task']}` | {row['cost']:.3f} | {proven} |"


def risk_rows(problems: tuple[str, ...]) -> Rows:
    """The mean loss of the worst tenth with the risk penalty, and without."""
    found = []
    for name in problems:
        problem = load(name)
        without = problem.with_(objective=replace(problem.objective, cvar=None))
        plans = {"with": ec.plan(problem), "without": ec.plan(without)}
        found.append({"problem": name} | {key: risk(problem, plan.controls)["cvar"] for key, plan in plans.items()})
    return found


def risk_lines(rows: Rows) -> Iterator[str]:
    """A line each; clearances are losses with the other sign."""
    yield from header("problem file", "of the worst tenth, on average", "with the penalty", "without")
    what = ("distance from the target", "smallest clearance")
    for row, words in zip(rows, what, strict=True):
        yield f"| `configs/{row['problem']}.yaml` | {words} | {_cm(row['with'])} | {_cm(row['without'])} |"


def _cm(value: float) -> str:
    """A length in centimetres."""
    return f"{100 * abs(value):.0f} cm"


def arrival_rows(problems: tuple[str, ...]) -> Rows:
    """Where the fleet ends, and how far apart it was at most, at one time."""
    found = []
    for name in problems:
        plan = proven_plan(load(name))
        paths = trajectories(plan.problem, plan.controls, plan.problem.fleet.grid(21))[..., :2]
        apart = np.linalg.norm(paths[:, None] - paths[None], axis=-1).max()
        found.append({"problem": name, "apart": float(apart), **plan.details["arrival"]})
    return found


def arrival_lines(rows: Rows) -> Iterator[str]:
    """A formation, and a mean with a covariance."""
    line, gather = rows
    deviation = np.sqrt(np.linalg.eigvalsh(gather["covariance"]).max())
    off = f"{metres(line['rms'])} RMS from the places wanted, {metres(line['largest'])} at most"
    yield f"- `configs/{line['problem']}.yaml` spreads the fleet along a line: {off}."
    yield f"- `configs/{gather['problem']}.yaml` drives a fleet with tractions 0.8 to 1.2 out, where its members are"
    yield f"  {metres(gather['apart'])} apart, and together to a standard deviation of at most {metres(deviation)}"
    yield f"  in any direction; the distribution wanted, 3 cm in each, is {metres(gather['distance'])} away."


def reach_rows(problems: tuple[str, ...]) -> Rows:
    """How close a fleet comes to lines of growing length."""
    return [_reach_row(problems[0], length) for length in LENGTHS]


def _reach_row(name: str, length: float) -> Row:
    """One length, along the way and across it."""
    row: Row = {"length": length}
    for key, way in (("along", ALONG), ("across", ACROSS)):
        low, high = ((MIDDLE + sign * way * length / 2).round(6).tolist() for sign in (-1, 1))
        half = length / 2 + 1
        box = [[round(float(x) - half, 6), round(float(x) + half, 6)] for x in MIDDLE]
        plan = proven_plan(
            load(
                name,
                (
                    f"regions.goal.box={box}",
                    "obstacles={}",
                    "task='F[14, 16] in(goal)'",
                    f"objective.terminal={{target: {{traction: [[0.9, {low}], [1.1, {high}]]}}, weight: 10000}}",
                    "objective.effort=0.001",
                ),
            )
        )
        row[key] = [plan.details["arrival"]["rms"], plan.details["arrival"]["largest"]]
    return row


def reach_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header("length of the line", "along the way", "across it")
    for row in rows:
        cells = [f"{metres(rms)} RMS, {metres(most)} at most" for rms, most in (row["along"], row["across"])]
        yield f"| {row['length']:g} m | {' | '.join(cells)} |"


TABLES = {
    "share": Table("docs/objectives.md", ("risk/share",), share_rows, share_lines),
    "risk": Table("docs/objectives.md", ("risk/cvar_terminal", "risk/cvar_clearance"), risk_rows, risk_lines),
    "arrival": Table("docs/targets.md", ("targets/line", "targets/gather"), arrival_rows, arrival_lines),
    "reach": Table("docs/targets.md", ("targets/line",), reach_rows, reach_lines),
}
