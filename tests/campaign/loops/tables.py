"""What the campaign found, as the page prints it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

BEGIN, END = "<!-- campaign of loops -->", "<!-- end of the campaign of loops -->"


def page(told: dict[str, Any]) -> str:
    """Two tables: what was run, and the margins that were taken out."""
    columns = ("loops", "success", "finished", "stopped", "failed", "faulty")
    proofs = ("steps proven whole", "steps proven period", "checks")
    rows = [
        "| loops of | " + " | ".join((*columns[:-1], *proofs[:2], "statements held against the truth", "false")) + " |",
        "|---" * 10 + "|",
    ]
    families = {name: counts for name, counts in told["families"].items() if name != "all"}
    for name, counts in [*families.items(), ("all", told["families"]["all"])]:
        numbers = {**counts, "success": counts.get("success", 0) + counts.get("proven", 0)}
        values = [numbers.get(column, 0) for column in (*columns[:-1], *proofs)]
        rows.append(f"| {name} | " + " | ".join(f"{value:,}" for value in (*values, counts["faulty"])) + " |")
    rows += ["", "| margin taken out | caught after | by |", "|---|---|---|"]
    for name, found in told["controls"].items():
        rows.append(f"| {name} | {found['loops']} loops | {', '.join(found['by'])} |")
    return "\n".join(rows)


def rewrite(path: Path, told: dict[str, Any]) -> None:
    """Print the tables into the page, between its marks."""
    before, _, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    path.write_text(f"{before}{BEGIN}\n{page(told)}\n{END}{after}", encoding="utf-8")
