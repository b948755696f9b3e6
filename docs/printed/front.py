"""What is said of the five obstacles on the first page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import ensemble_ctrl as ec
from ensemble_ctrl.api.comparison import compare
from ensemble_ctrl.api.widening import widest
from printed import ROOT, read, rounded_down
from printed.table import FIVE, Rows, Table, header, load

GALLERY = ROOT / "docs" / "_static" / "gallery" / "facts.json"


def measured_rows(problems: tuple[str, ...]) -> Rows:
    """Replay, proof, guarantees and the widest fleet."""
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
    for one in compare(problem, ("moment", "nodes", "hull")):
        assert one.plan.replayed is not None
        row[one.name] = one.violating / one.plan.replayed.members
    return [row]


def measured_lines(rows: Rows) -> Iterator[str]:
    """A line each, with the command that shows it."""
    (row,) = rows
    five = f"configs/{FIVE}.yaml"
    gallery = read(GALLERY).values()
    certified = f"{sum(f['proven'] == 'yes' for f in gallery)} of {len(gallery)}"
    low, high = row["widest"]
    bound = f"{rounded_down(row['clearance']):.4f} m / {row['seen']:.4f} m"
    run, compared = f"ensemble-plan {five} --members 100000 --set verify.substeps=10", f"ensemble-plan compare {five}"
    others = f"{100 * row['nodes']:.0f} %, {100 * row['hull']:.0f} %"
    yield from header("what", "result", "command")
    for what, result, command in (
        ("members of 100,000 that violate the task, 10 samples per step", f"{row['violating']}", run),
        ("proven clearance / smallest distance seen", bound, f"ensemble-plan verify plans/{FIVE}"),
        ("members that violate the task with constraints on moments", f"{100 * row['moment']:.0f} %", compared),
        ("the same with constraints at nodes, with hulls", others, compared),
        ("widest traction range with a certified plan", f"{low:.3f} to {high:.3f}", f"ensemble-plan widest {five}"),
        ("problems of `configs/` certified", certified, "python docs/make_gallery.py"),
    ):
        yield f"| {what} | {result} | `{command}` |"


TABLES = {"measured": Table("README.md", (FIVE,), measured_rows, measured_lines)}
