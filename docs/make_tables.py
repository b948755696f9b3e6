"""Run what the pages' tables say and write the tables: ``python docs/make_tables.py [NAME ...]``.

Each table is kept as ``docs/_static/tables/<name>.json`` and stands on its page between two comments that name it. Runs
the tables named, else those that are stale, because a problem or the code that plans and proves has changed since.
``--write`` runs nothing and writes the pages from what is kept; ``--check`` runs nothing, and fails where a table is
stale.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import printed

import ensemble_ctrl as ec
from ensemble_ctrl.api.comparison import SUBSTEPS, compare
from ensemble_ctrl.api.widening import widest
from ensemble_ctrl.ocp.truncation import plain, tail

Rows = list[dict[str, Any]]
DOCS = printed.ROOT / "docs"
TABLES = DOCS / "_static" / "tables"
CONFIGS = printed.ROOT / "configs"
FIVE = "five_obstacles"


@dataclass(frozen=True)
class Table:
    """A table of figures: the page where it stands, the problems that decide it, what makes its rows and its lines."""

    page: str
    problems: tuple[str, ...]
    run: Callable[[tuple[str, ...]], Rows]
    lines: Callable[[Rows], Iterator[str]]

    def source(self) -> str:
        """Digest of the code and the problems."""
        return " ".join(printed.source(CONFIGS / f"{name}.yaml") for name in self.problems)


def load(name: str) -> ec.Problem:
    """A problem of `configs/`."""
    problem = ec.load(CONFIGS / f"{name}.yaml")
    assert isinstance(problem, ec.Problem)
    return problem


# --- which facets


def minlp_rows(problems: tuple[str, ...]) -> Rows:
    """Costs of the best plan of each kind of round."""
    return [_minlp_row(name) for name in problems]


def _minlp_row(name: str) -> dict[str, Any]:
    """One problem, planned with facets."""
    problem = load(name)
    plan = ec.plan(problem.with_(solve=replace(problem.solve, method="minlp")))
    found = plan.details["minlp"]
    kinds: dict[str, list[float]] = {"lines": [], "fixed": [], "bonmin": []}
    for one in found["rounds"]:
        kind = "lines" if one["name"].startswith("lines") else "fixed" if one["name"] == "facets fixed" else "bonmin"
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
    yield "| `configs/` | nlp | lines alone | facets fixed | Bonmin | plan | certified |"
    yield "|---|---|---|---|---|---|---|"
    for row in rows:
        costs = ["–" if row[key] is None else f"{row[key]:.4f}" for key in ("nlp", "lines", "fixed", "bonmin", "plan")]
        yield f"| `{row['problem']}` | {' | '.join(costs)} | {row['proven']} |"


# --- guarantees


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
    yield f"| guarantee, method | {members} | worst depth | cost |"
    yield "|---|---|---|---|"
    for row in rows:
        depth = f"{row['depth']:.3f} m" if row["violating"] else "0"
        name, _, method = row["name"].partition(", ")
        yield f"| `{name}`{', `minlp`' if method else ''} | {_share(row)} | {depth} | {row['cost']:.3f} |"


def _share(row: dict[str, Any]) -> str:
    """Members that violate the task, in per cent too unless none does."""
    share = f" ({100 * row['violating'] / row['members']:.0f} %)" if row["violating"] else ""
    return f"{row['violating']:,}{share}"


# --- a share of the fleet


def share_rows(problems: tuple[str, ...]) -> Rows:
    """A share of the fleet, and everybody."""
    problem = load(problems[0])
    (part,) = [problem.task]
    everybody = problem.with_(task=part.child)  # type: ignore[attr-defined]
    found = []
    for one in (problem, everybody):
        plan = ec.plan(one)
        certificate = plan.certificate
        assert certificate is not None
        assert certificate.proven == "yes"
        proven = min((bound.share for bound in certificate.parts if bound.share is not None), default=1.0)
        found.append({"task": str(one.task), "cost": plan.details["cost"], "proven": proven})
    return found


def share_lines(rows: Rows) -> Iterator[str]:
    """A line each."""
    yield "| task | cost | proven |"
    yield "|---|---|---|"
    for row in rows:
        proven = "everybody" if row["proven"] == 1.0 else f"{100 * row['proven']:.1f} % of the fleet"
        yield f"| `{row['task']}` | {row['cost']:.3f} | {proven} |"


# --- fleets


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
    yield "| problem file | parameters | nodes | points | proven |"
    yield "|---|---|---|---|---|"
    for row in rows:
        counts = f"{row['nodes']} | {row['points']}"
        yield f"| `configs/{row['problem']}.yaml` | {row['parameters']} | {counts} | {row['proven']} |"


# --- truncation


def truncation_rows(problems: tuple[str, ...]) -> Rows:
    """The largest distance of a member from the truncated curve, order by order."""
    problem = load(problems[0])
    controls = ec.plan(problem).controls
    return [{"order": n, "error": tail(problem, controls, plain((n,), hull=False))} for n in (1, 2, 3, 4, 6, 8)]


def truncation_lines(rows: Rows) -> Iterator[str]:
    """One line."""
    yield f"| order | {' | '.join(str(row['order']) for row in rows)} |"
    yield f"|---|{'---|' * len(rows)}"
    yield f"| error [m] | {' | '.join(_power(row['error']) for row in rows)} |"


def _power(value: float) -> str:
    """Two digits, and the power of ten without its zero."""
    digits, power = f"{value:.1e}".split("e")
    return f"{digits}e{int(power)}"


# --- the first page


def measured_rows(problems: tuple[str, ...]) -> Rows:
    """What is said of the five obstacles on the first page."""
    problem = load(problems[0])
    plan = ec.plan(problem.with_(verify=replace(problem.verify, members=100_000, substeps=10)))
    assert plan.certificate is not None
    assert plan.replayed is not None
    widened = widest(problem).interval
    assert widened is not None
    row = {
        "violating": int(plan.replayed.violating.sum()),
        "clearance": plan.certificate.clearance,
        "seen": min(c.distance for c in plan.replayed.clearances),
        "widest": [widened.lower, widened.upper],
    }
    names = ("moment", "nodes", "hull")
    for one in compare(problem, names):
        assert one.plan.replayed is not None
        row[one.name] = one.violating / one.plan.replayed.members
    return [row]


def measured_lines(rows: Rows) -> Iterator[str]:
    """A line each, with the command that shows it."""
    (row,) = rows
    five = f"configs/{FIVE}.yaml"
    gallery = printed.read(DOCS / "_static" / "gallery" / "facts.json").values()
    certified = f"{sum(f['proven'] == 'yes' for f in gallery)} of {len(gallery)}"
    low, high = row["widest"]
    bound = f"{printed.rounded_down(row['clearance']):.4f} m / {row['seen']:.4f} m"
    run, compared = f"ensemble-plan {five} --members 100000 --set verify.substeps=10", f"ensemble-plan compare {five}"
    others = f"{100 * row['nodes']:.0f} %, {100 * row['hull']:.0f} %"
    yield "| what | result | command |"
    yield "|---|---|---|"
    for what, result, command in (
        ("members of 100,000 that violate the task, 10 samples per step", f"{row['violating']}", run),
        ("proven clearance / smallest distance seen", bound, f"ensemble-plan verify plans/{FIVE}"),
        ("members that violate the task with constraints on moments", f"{100 * row['moment']:.0f} %", compared),
        ("the same with constraints at nodes, with hulls", others, compared),
        ("widest traction range with a certified plan", f"{low:.3f} to {high:.3f}", f"ensemble-plan widest {five}"),
        ("problems of `configs/` certified", certified, "python docs/make_gallery.py"),
    ):
        yield f"| {what} | {result} | `{command}` |"


OBSTACLES = tuple(f"{word}_obstacles" for word in ("one", "three", "five", "six", "seven", "eight"))
FLEETS = ("wide", "cells", "two_tractions", "measured_pairs", "uncertain_start", "bicycle")
TABLES_OF = {
    "minlp": Table("docs/minlp.md", OBSTACLES, minlp_rows, minlp_lines),
    "guarantees": Table("docs/guarantees.md", (FIVE,), guarantee_rows, guarantee_lines),
    "share": Table("docs/objectives.md", ("risk/share",), share_rows, share_lines),
    "fleets": Table("docs/fleets.md", (FIVE, *(f"fleets/{name}" for name in FLEETS)), fleet_rows, fleet_lines),
    "truncation": Table("docs/how_it_works.md", (FIVE,), truncation_rows, truncation_lines),
    "measured": Table("README.md", (FIVE,), measured_rows, measured_lines),
}
"""Name of each table and what makes it."""


def stale(name: str) -> bool:
    """Whether a table is of other code or other problems."""
    return bool(printed.read(_file(name)).get("source") != TABLES_OF[name].source())


def _file(name: str) -> Path:
    """Where a table is kept."""
    return TABLES / f"{name}.json"


def lines_of(name: str) -> list[str]:
    """The table's lines, from its file."""
    return list(TABLES_OF[name].lines(printed.read(_file(name))["rows"]))


def main(arguments: list[str]) -> None:
    """Run what is asked for, else what is stale, and write the pages.

    Raises
    ------
    SystemExit
        With ``--check``, if a table is stale.
    """
    names = [name for name in TABLES_OF if stale(name)]
    if "--check" in arguments:
        raise SystemExit(f"stale: {', '.join(names)}; run python docs/make_tables.py" if names else 0)
    for name in () if "--write" in arguments else arguments or names:
        source = TABLES_OF[name].source()
        rows = TABLES_OF[name].run(TABLES_OF[name].problems)
        printed.write(_file(name), {"source": source, "rows": rows})
        print(name, *lines_of(name), sep="\n", flush=True)
    for name in TABLES_OF:
        path = printed.ROOT / TABLES_OF[name].page
        text, _ = printed.block(path.read_text(encoding="utf-8"), name, lines_of(name))
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
