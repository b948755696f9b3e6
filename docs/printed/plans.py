"""Plans of `configs/`: guarantees, facets, fleets and truncation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import ensemble_ctrl as ec
from ensemble_ctrl.api.comparison import SUBSTEPS, compare
from ensemble_ctrl.ocp.truncation import plain, tail
from printed.table import FIVE, Row, Rows, Table, header, load, power

OBSTACLES = tuple(f"{word}_obstacles" for word in ("one", "three", "five", "six", "seven", "eight"))
FLEETS = ("wide", "cells", "two_tractions", "measured_pairs", "uncertain_start", "bicycle")
TRACTION = ec.Interval(0.9, 1.1)
APART = {"linear_traction": TRACTION, "angular_traction": TRACTION}
KIND_OF = dict.fromkeys(("hyperplanes chosen again", "hyperplanes on the coarse grid"), "hyperplanes")
KIND_OF["facets fixed"] = "fixed"
"""Kind of a round by its name; in all others facets are chosen by Bonmin."""
KINDS = ("hyperplanes", "fixed", "bonmin")
GROWN = ({"traction": TRACTION}, APART, {**APART, "start_heading": ec.Interval(-0.1, 0.1)})
"""Fleets whose parameters vary together, apart, and apart with an uncertain heading."""


def minlp_rows(problems: tuple[str, ...]) -> Rows:
    """Costs of the best plan of each kind of round."""
    return [_minlp_row(name) for name in problems]


def _minlp_row(name: str) -> Row:
    """One problem, planned with facets."""
    problem = load(name)
    plan = ec.plan(problem.with_(solve=replace(problem.solve, method="minlp")))
    found = plan.details["minlp"]
    kinds: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for one in found["rounds"]:
        kind = KIND_OF.get(one["name"], "bonmin")
        kinds[kind] += [] if one["cost"] is None else [one["cost"]]
    assert plan.certificate is not None
    return {
        "problem": name,
        "nlp": found["nlp_cost"],
        **{kind: min(costs, default=None) for kind, costs in kinds.items()},
        "plan": found["cost"],
        "proven": plan.certificate.proven,
    }


def minlp_lines(rows: Rows) -> Iterator[str]:
    """Problem by problem."""
    yield from header("`configs/`", "nlp", "hyperplanes alone", "facets fixed", "Bonmin", "plan", "certified")
    for row in rows:
        costs = ["–" if row[key] is None else f"{row[key]:.4f}" for key in ("nlp", *KINDS, "plan")]
        yield f"| `{row['problem']}` | {' | '.join(costs)} | {row['proven']} |"


def guarantee_rows(problems: tuple[str, ...]) -> Rows:
    """How many members violate the task under each guarantee and method."""
    rows = compare(load(problems[0]))
    return [
        {
            "name": row.name,
            "violating": row.violating,
            "members": row.plan.replayed.members if row.plan.replayed else 0,
            "depth": row.depth,
            "cost": row.cost,
        }
        for row in rows
    ]


def guarantee_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    members = f"of {rows[0]['members']:,} members, {SUBSTEPS} samples per step, violate"
    yield from header("guarantee, method", members, "worst depth", "cost")
    for row in rows:
        depth = f"{row['depth']:.3f} m" if row["violating"] else "0"
        name, _, method = row["name"].partition(", ")
        yield f"| `{name}`{', `minlp`' if method else ''} | {_share(row)} | {depth} | {row['cost']:.3f} |"


def _share(row: Row) -> str:
    """Members that violate the task, in per cent too unless none does."""
    share = f" ({100 * row['violating'] / row['members']:.0f} %)" if row["violating"] else ""
    return f"{row['violating']:,}{share}"


def fleet_rows(problems: tuple[str, ...]) -> Rows:
    """Nodes and points of each plan."""
    found = []
    for name in problems:
        problem = load(name)
        plan = ec.plan(problem)
        assert plan.certificate is not None
        found.append(
            {
                "problem": name,
                "parameters": ", ".join(problem.fleet.names),
                "nodes": _count(plan.details["orders"]),
                "points": _count(plan.details["degrees"]),
                "proven": plan.certificate.proven,
            }
        )
    return found


def _count(orders: list[int]) -> int:
    """Nodes of a tensor rule of these orders."""
    total = 1
    for order in orders:
        total *= order + 1
    return total


def fleet_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header("problem file", "parameters", "nodes", "points", "proven")
    for row in rows:
        counts = f"{row['nodes']} | {row['points']}"
        yield f"| `configs/{row['problem']}.yaml` | {row['parameters']} | {counts} | {row['proven']} |"


def cells_rows(problems: tuple[str, ...]) -> Rows:
    """Plans of a wide fleet with hyperplanes for all of it, and for parts of its range."""
    found = []
    for cells in (1, 4):
        plan = ec.plan(load(problems[0], [f"solve.cells={cells}"]), check=False)
        proven = "no plan" if plan.certificate is None or plan.status != "planned" else plan.certificate.proven
        found.append({"cells": cells, "cost": plan.details["cost"], "proven": proven})
    return found


def cells_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield from header("`solve.cells`", "cost", "proven")
    for row in rows:
        yield f"| {row['cells']} | {row['cost']:.1f} | {row['proven']} |"


def truncation_rows(problems: tuple[str, ...]) -> Rows:
    """The largest distance of a member from the truncated curve, order by order."""
    problem = load(problems[0])
    controls = ec.plan(problem).controls
    return [{"order": n, "error": tail(problem, controls, plain((n,), hull=False))} for n in (1, 2, 3, 4, 6, 8)]


def truncation_lines(rows: Rows) -> Iterator[str]:
    """One line."""
    yield from header("order", *(str(row["order"]) for row in rows))
    yield f"| error [m] | {' | '.join(power(row['error']) for row in rows)} |"


def growth_rows(problems: tuple[str, ...]) -> Rows:
    """Nodes and truncation error of one plan for fleets with more and more parameters, order by order."""
    plan = ec.plan(load(problems[0]))
    found = []
    for order in range(1, 6):
        row: Row = {"order": order, "nodes": [], "error": []}
        for distributions in GROWN:
            problem = plan.problem.with_(fleet=replace(plan.problem.fleet, parameters=distributions))
            truncation = plain((order,) * len(distributions), hull=True)
            row["nodes"].append(truncation.collocation.count)
            row["error"].append(tail(problem, plan.controls, truncation))
        found.append(row)
    return found


def growth_lines(rows: Rows) -> Iterator[str]:
    """Order by order, the error to one digit."""
    yield from header("order", "1 parameter", "2 parameters", "3 parameters")
    for row in rows:
        cells = [f"{n} nodes, {power(x, 1)} m" for n, x in zip(row["nodes"], row["error"], strict=True)]
        yield f"| {row['order']} | {' | '.join(cells)} |"


TABLES = {
    "minlp": Table("docs/minlp.md", OBSTACLES, minlp_rows, minlp_lines),
    "guarantees": Table("docs/guarantees.md", (FIVE,), guarantee_rows, guarantee_lines),
    "fleets": Table("docs/fleets.md", (FIVE, *(f"fleets/{name}" for name in FLEETS)), fleet_rows, fleet_lines),
    "cells": Table("docs/guarantees.md", ("fleets/cells",), cells_rows, cells_lines),
    "truncation": Table("docs/how_it_works.md", (FIVE,), truncation_rows, truncation_lines),
    "growth": Table("docs/fleets.md", (FIVE,), growth_rows, growth_lines),
}
