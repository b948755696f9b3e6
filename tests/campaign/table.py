"""The campaign's result: how many cases of each family were decided, and how many claims were false."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Self

MOST_OPEN = 0.05
"""Share of the cases decided by brute force that may be left open."""
KINDS = ("false yes", "bound", "false no", "counter-example", "refusal", "crash")
MARK = "campaign"
"""Stands in comments before and after the table on a page."""


@dataclass(frozen=True)
class Line:
    """One case in short."""

    index: int
    family: str
    verdict: str
    decided: str
    seconds: float
    faults: tuple[dict[str, Any], ...]


@dataclass
class Table:
    """Counts for each family.

    Attributes
    ----------
    seed : int
        Of all cases.
    rows : dict of str to Counter
        For each family the number of ``cases``, of each verdict, of cases that are ``decidable`` by brute force and of
        those ``left open``, and of each kind of false claim.
    worst : float
        Metres by which the worst claim was wrong.
    slowest : float
        Seconds that the slowest case took, the oracle's included.
    """

    seed: int
    rows: dict[str, Counter[str]] = field(default_factory=dict)
    worst: float = 0.0
    slowest: float = 0.0

    @classmethod
    def of_json(cls, text: str) -> Self:
        """A saved one."""
        told = json.loads(text)
        rows = {name: Counter(row) for name, row in told["rows"].items()}
        return cls(told["seed"], rows, told["worst"], told["slowest"])

    def as_json(self) -> str:
        """For a file."""
        return json.dumps(vars(self), indent=1, sort_keys=True) + "\n"

    @property
    def cases(self) -> int:
        """How many there were."""
        return self.total["cases"]

    @property
    def total(self) -> Counter[str]:
        """Counts of all families."""
        return sum(self.rows.values(), Counter())

    @property
    def is_bad(self) -> bool:
        """Whether a claim was false, or too much was left open."""
        total = self.total
        return any(total[kind] for kind in KINDS) or total["left open"] > MOST_OPEN * total["decidable"]

    def add(self, line: Line) -> None:
        """Count a case."""
        row = self.rows.setdefault(line.family, Counter())
        row["cases"] += 1
        row[line.verdict] += 1
        judged = bool(line.decided) and line.verdict in ("yes", "no", "undecided")
        row["decidable"] += judged
        row["left open"] += judged and line.verdict == "undecided"
        row.update({fault["kind"] for fault in line.faults})
        self.worst = max([self.worst, *(fault["excess"] for fault in line.faults)])
        self.slowest = max(self.slowest, line.seconds)

    def as_markdown(self) -> str:
        """For a page of the documentation."""
        head = ("family", "cases", "yes", "no", "undecided", "refused", "left open", *NAMES)
        lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        for name, row in (*sorted(self.rows.items()), ("**all**", self.total)):
            left = f"{100 * row['left open'] / max(row['decidable'], 1):.1f} %"
            counts = [row["cases"], row["yes"], row["no"], row["undecided"], row["refused"], left]
            lines.append("| " + " | ".join(map(str, [name, *counts, *(row[kind] for kind in KINDS)])) + " |")
        return f"Seed {self.seed}, {self.cases} cases.\n\n" + "\n".join(lines)


NAMES = ("false *yes*", "bound above the truth", "false *no*", "wrong counter-example", "false refusal", "crash")


def printed(page: str, table: str, mark: str = MARK) -> str:
    """A page with another table between its marks."""
    begin, end = _marks(mark)
    before, _, rest = page.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n\n{table}\n\n{end}{after}"


def read(page: str, mark: str = MARK) -> str:
    """The table between the marks of a page."""
    begin, end = _marks(mark)
    return page.partition(begin)[2].partition(end)[0].strip()


def _marks(mark: str) -> tuple[str, str]:
    """Comments before and after a table."""
    return f"<!-- {mark} -->", f"<!-- /{mark} -->"
