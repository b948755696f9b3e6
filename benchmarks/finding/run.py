"""Try every problem of every family: ``python -m benchmarks.finding.run [--family NAME] [--seconds 60] [--plain]``.

Prints, per family, how many plans were found and proven, in what time, and at what cost against the best known. Each
problem is a unit of `ensemble_ctrl.core.jobs`, in a process of its own; a line of JSON is kept for each, so that a run
that was killed goes on where it stopped. Another version of the program, or another limit, is tried anew.

One problem is tried at a time, so that times can be compared; ``--cluster local:2`` tries two. Workers of a Dask
cluster have to be started at the root of this checkout.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from ensemble_ctrl.core.jobs import Cluster, Content, Outcome, Unit, outcomes
from ensemble_ctrl.core.storage import Lines

from . import best, one
from .case import HERE, Case
from .families import FAMILIES, drawn

ROOT = HERE.parents[1]
RESULTS = HERE / "results.jsonl"
MORE = 120.0
"""Seconds beyond the limit after which a process is ended: for reading, drawing and judging."""

Row = dict[str, Any]


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """The command's own."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.finding.run", description=__doc__.split("\n")[0])
    parser.add_argument("--family", choices=FAMILIES, action="append", help="only this family; may be repeated")
    parser.add_argument("--problems", type=int, help="only the first so many of each family")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each problem (60)")
    parser.add_argument("--cluster", type=Cluster.parse, default="local:1", help="where: local:N or tcp://HOST:PORT")
    parser.add_argument("--plain", action="store_true", help="the plain program, too")
    parser.add_argument("--record", action="store_true", help="keep the table for docs/benchmarks.md")
    parser.add_argument("--results", type=Path, default=RESULTS, help="file of what was tried already")
    return parser.parse_args(given)


def source() -> str:
    """What distinguishes this version of the planner, and of what judges it, from another."""
    judges = (HERE / name for name in ("one.py", "judge.py", "plain.py"))
    files = [*sorted((ROOT / "src").rglob("*.py")), *judges]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def key(case: Case, program: str, seconds: float, version: str) -> Row:
    """What a line of the results is about."""
    about = {"name": case.name, "family": case.family, "seed": case.seed, "problem": case.digest}
    return {**about, "program": program, "limit": seconds, "version": version}


def kept(path: Path) -> list[Row]:
    """Lines of an earlier run; one that a killed run left half is dropped."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def about_of(row: Row, about: Row) -> Row:
    """What a line is about, without what came of it."""
    return {name: row.get(name) for name in about}


def untried(wanted: Sequence[Row], rows: Sequence[Row]) -> list[Row]:
    """Those that no line is about."""
    return [about for about in wanted if about not in [about_of(row, about) for row in rows]]


def unit_of(about: Row) -> Unit:
    """One problem as a unit, given up when it takes far too long."""
    name = f"{about['name']} {about['program']}"
    return Unit(one.__name__, Content(json.dumps(about)), name=name, limit=about["limit"] + MORE, alone=True)


def row_of(about: Row, outcome: Outcome) -> Row:
    """The line of a problem that was tried."""
    if outcome.late:
        return {**about, "outcome": "killed", "seconds": about["limit"] + MORE, "cost": None}
    if outcome.failure:
        message = outcome.error or outcome.killed
        return {**about, "outcome": "error", "seconds": about["limit"], "cost": None, "message": message}
    return {**about, **outcome.result}


def attempts(rest: Sequence[Row], cluster: Cluster) -> Iterator[Row]:
    """The lines of problems, as they end."""
    waiting = {unit_of(about): about for about in rest}
    for outcome in outcomes(list(waiting), cluster):
        yield row_of(waiting[outcome.unit], outcome)


def try_all(rest: Sequence[Row], cluster: Cluster, results: Path) -> None:
    """Try problems, and keep a line of each as it ends."""
    lines = Lines(results)
    try:
        # reading cuts off a half line, which the first new one would be joined to
        for _ in lines.read():
            pass
        for number, row in enumerate(attempts(rest, cluster), 1):
            lines.add(json.dumps(row).encode())
            said = f"{row['name']} {row['program']}: {row['outcome']}, {row['seconds']:.1f} s {row.get('message', '')}"
            print(f"[{number}/{len(rest)}] {said}", file=sys.stderr, flush=True)
    finally:
        lines.close()


def learn(rows: Iterable[Row]) -> None:
    """Improve the best known costs by those of proven plans and of known ones."""
    record: best.Record = {}
    for row in rows:
        if row.get("known") is not None:
            record = best.improved(record, row["name"], row["problem"], row["known"], "known plan")
        if row["outcome"] == "proven" and row["cost"] is not None:
            record = best.improved(record, row["name"], row["problem"], row["cost"], row["program"])
    best.write(record)


def right(row: Row) -> bool:
    """Whether a plan was found; for an impossible problem, whether none was."""
    good = ("none", "refused") if row["family"] == "impossible" else ("found", "proven")
    return row["outcome"] in good


def shown(row: Row) -> bool:
    """Whether that is proven: by a certificate, or by the check that refuses an impossible problem."""
    return bool(row["outcome"] == ("refused" if row["family"] == "impossible" else "proven"))


def wrong(row: Row) -> bool:
    """Whether a claim is false: a plan where there is none, a refusal where there is one, a proof that is refuted."""
    claims = ("found", "proven", "wrong") if row["family"] == "impossible" else ("refused", "wrong")
    return row["outcome"] in claims


def above_best(rows: Iterable[Row], record: best.Record) -> float | None:
    """Median of what proven plans cost more than the best known."""
    known = [row for row in rows if row["outcome"] == "proven" and row["name"] in record]
    return median(row["cost"] - record[row["name"]]["cost"] for row in known) if known else None


def summary(rows: Sequence[Row]) -> list[Row]:
    """A row for each family and program."""
    record, found = best.read(), []
    for family in FAMILIES:
        for program in ("planner", "plain"):
            those = [row for row in rows if (row["family"], row["program"]) == (family, program)]
            if those:
                found.append(
                    {
                        "family": family,
                        "program": program,
                        "tried": len(those),
                        "of": FAMILIES[family][0],
                        "found": sum(map(right, those)),
                        "proven": sum(map(shown, those)),
                        "wrong": sum(map(wrong, those)),
                        "seconds": median(row["seconds"] for row in those),
                        "above_best": above_best(those, record),
                    }
                )
    return found


def lines(rows: Sequence[Row]) -> Iterable[str]:
    """The summary as a table of text."""
    columns = f"{'tried':>8} {'found':>6} {'proven':>6} {'wrong':>6} {'median':>8} {'cost':>8}"
    yield f"{'family':12} {'program':8} {columns}"
    for row in rows:
        more = "-" if row["above_best"] is None else f"+{row['above_best']:.3f}"
        counts = f"{row['tried']:8d} {row['found']:6d} {row['proven']:6d} {row['wrong']:6d}"
        yield f"{row['family']:12} {row['program']:8} {counts} {row['seconds']:6.1f} s {more:>8}"


def record(name: str, rows: list[Row]) -> None:
    """Keep the table with the machine, as the other benchmarks do, which are scripts."""
    sys.path.insert(0, str(HERE.parent))
    from record import record as keep

    keep(name, rows)


def main() -> None:
    """Try what is not tried yet, and print the summary."""
    given, version = arguments(), source()
    programs = ("planner", "plain") if given.plain else ("planner",)
    families = given.family or list(FAMILIES)
    counts = {family: min(FAMILIES[family][0], given.problems or FAMILIES[family][0]) for family in families}
    cases = [drawn(family, seed) for family, count in counts.items() for seed in range(count)]
    wanted = [key(case, program, given.seconds, version) for case in cases for program in programs]
    rest = untried(wanted, kept(given.results))
    try_all(rest, given.cluster, given.results)
    rows = [row for row in kept(given.results) if about_of(row, wanted[0]) in wanted]
    learn(rows)
    found = summary(rows)
    if given.record:
        record("finding", [row | {"limit": given.seconds, "jobs": given.cluster.workers} for row in found])
    print("\n".join(lines(found)))


if __name__ == "__main__":
    main()
