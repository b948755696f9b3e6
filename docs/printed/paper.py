"""The paper's experiments as published, beside this package's plans, and the study of truncation orders."""

from __future__ import annotations

from collections.abc import Iterator

from printed.table import Row, Rows, Timed, header, metres, power
from printed.times import seconds


def experiment_lines(rows: Rows, machine: str) -> Iterator[str]:
    """A line for each experiment, robot and form."""
    members = f"of {max(row['members'] for row in rows):,} members violate"
    yield from header("experiment", "robot", "form", "time", "iterations", "cost", members, "worst depth", "proven")
    for row in rows:
        cells = (_name(row), row["robot"], _form(row), seconds(row["seconds"]))
        depth = metres(row["depth"]) if row["violating"] else "0"
        if row["status"] == "no solution":
            yield f"| {' | '.join(cells)} | {row['iterations']} | none found | – | – | – |"
            continue
        found = (str(row["iterations"]), f"{row['cost']:.3f}", _share(row), depth, row["proven"])
        yield f"| {' | '.join((*cells, *found))} |"
    yield from ("", f"Two at a time, on {machine}.")


def _name(row: Row) -> str:
    """The experiment in words."""
    return {"one_obstacles": "one obstacle", "two_waypoints": "two way-points"}.get(
        row["experiment"], row["experiment"].replace("_", " ")
    )


def _form(row: Row) -> str:
    """The form, and whose facets a published plan has."""
    return f"{row['form']}, {row['facets']}" if row["facets"] else str(row["form"])


def _share(row: Row) -> str:
    """Members that violate the task, in per cent too unless none does."""
    share = f" ({100 * row['violating'] / row['members']:.0f} %)" if row["violating"] else ""
    return f"{row['violating']:,}{share}"


def bonmin_lines(rows: Rows, machine: str) -> Iterator[str]:
    """How far Bonmin got on the problem's own grid with all facets."""
    yield from header("experiment", "robot", "Bonmin", "nodes", "incumbent", "bound", "gap")
    for row in (row for row in rows if row["bonmin"]):
        found = "yes" if row["facets"] == "Bonmin" else "none"
        bound, gap = ("–" if row[name] is None else f"{row[name]:.3g}" for name in ("bound", "gap"))
        yield f"| {_name(row)} | {row['robot']} | {row['bonmin']} | {row['nodes']} | {found} | {bound} | {gap} |"


def summary_lines(rows: Rows, machine: str) -> Iterator[str]:
    """What the published form costs, and what ours adds, in one sentence."""
    published, ours = ([row for row in rows if row["form"] == form] for form in ("published", "ours"))
    published = [row for row in published if row["status"] != "no solution"]
    unsafe = [row for row in published if row["violating"]]
    depth = max((row["depth"] for row in unsafe), default=0.0)
    proven = sum(row["proven"] == "yes" for row in ours)
    linear = {row["experiment"]: row["cost"] for row in rows if row["form"] == "linear"}
    own = {row["experiment"]: row["cost"] for row in ours if row["robot"] == "unicycle"}
    better = [name for name, cost in linear.items() if cost < own[name] - 1e-4]
    yield (
        f"Of {len(published)} plans in the published form {len(unsafe)} have members that violate the task, by up to "
        f"{metres(depth)}; {sum(row['proven'] == 'yes' for row in published)} are proven. Of {len(ours)} of ours "
        f"{proven} are proven for every member and instant. With the linear model's path and facets, {len(better)} of "
        f"{len(linear)} of these cost less."
    )


def order_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Both forms, and what moments allow, for every order."""
    share = f"of {rows[0]['members']:,} violate"
    yield from header("order", "published: cost", share, "ours: cost", share, "proven", "largest abs(x) allowed")
    reach = {row["order"]: row["value"] for row in rows if row["kind"] == "reach"}
    plans = {(row["form"], row["order"]): row for row in rows if row["kind"] == "plan"}
    for order, value in reach.items():
        cells = [cell for form in ("published", "ours") for cell in _planned(plans.get((form, order)))]
        proven = plans[("ours", order)]["proven"] if ("ours", order) in plans else "–"
        yield f"| {order} | {' | '.join(cells)} | {proven} | {value:.1f} |"


def _planned(row: Row | None) -> tuple[str, str]:
    """Cost and share of one plan."""
    return ("–", "–") if row is None else (f"{row['cost']:.3f}", _share(row))


def range_lines(rows: Rows, machine: str) -> Iterator[str]:
    """Truncation errors for ranges of the traction, by order."""
    own = [row for row in rows if row["kind"] == "truncation"]
    orders = [order for order in dict.fromkeys(row["order"] for row in own) if order in (1, 2, 3, 4, 6, 8, 10, 12, 16)]
    errors = {(row["half_width"], row["order"]): row["error"] for row in own}
    yield from header("traction", *(f"order {order}" for order in orders))
    for half in dict.fromkeys(row["half_width"] for row in own):
        yield f"| 1 ± {half:g} | {' | '.join(power(errors[half, order]) for order in orders)} |"


TABLES = {
    "paper_summary": Timed("docs/paper.md", "paper", summary_lines),
    "paper": Timed("docs/paper.md", "paper", experiment_lines),
    "paper_bonmin": Timed("docs/paper.md", "paper", bonmin_lines),
    "paper_orders": Timed("docs/paper.md", "paper_study", order_lines),
    "paper_ranges": Timed("docs/paper.md", "paper_study", range_lines),
}
