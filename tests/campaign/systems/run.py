"""Run the campaign: ``python -m tests.campaign.systems.run --cases 260 --members 80 --jobs 2``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.paths import ROOT

from .cases import make
from .judge import Judged, judge

RESULT = Path(__file__).parent / "result.json"
PAGE = ROOT / "docs" / "proof_systems.md"
BEGIN, END = "<!-- campaign of systems -->", "<!-- end of the campaign of systems -->"
CHUNK = 10
SAVED = 20
"""Cases after which the result is written."""
OPEN = 0.1
"""Share of the cases without an enclosure that is too large."""


@dataclass(frozen=True)
class Line:
    """One case in short."""

    index: int
    family: str
    judged: Judged
    seconds: float


def one(seed: int, index: int, members: int) -> Line:
    """The case of a number, judged."""
    case, began = make(seed, index, members), time.process_time()
    try:
        judged = judge(case, np.random.default_rng([seed, index, 1]))
    except Exception as error:
        raise RuntimeError(f"case {seed}:{index} of {case.family} broke off: {error!r}") from error
    return Line(index, case.family, judged, time.process_time() - began)


def some(seed: int, indices: Iterable[int], members: int) -> list[Line]:
    """Some cases, judged."""
    return [one(seed, index, members) for index in indices]


def lines(seed: int, cases: int, members: int, jobs: int) -> Iterator[Line]:
    """All cases in order."""
    chunks = [range(first, min(first + CHUNK, cases)) for first in range(0, cases, CHUNK)]
    with ProcessPoolExecutor(jobs) as pool:
        for done in pool.map(some, [seed] * len(chunks), chunks, [members] * len(chunks)):
            yield from done


def table(found: Iterable[Line]) -> dict[str, dict[str, Any]]:
    """Counts for each family and for all, and the median of the radius."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    radii: dict[str, list[float]] = defaultdict(list)
    for line in found:
        for name in (line.family, "all"):
            counts[name]["cases"] += 1
            counts[name]["triples"] += line.judged.triples
            counts[name]["no enclosure" if line.judged.reason else line.judged.verdict] += 1
            counts[name]["faulty"] += bool(line.judged.faults)
            radii[name] += [] if line.judged.reason else [line.judged.radius]
    names = [*sorted(set(counts) - {"all"}), "all"]
    return {name: {**counts[name], "radius": float(f"{np.median(radii[name] or [0.0]):.1e}")} for name in names}


def page(told: dict[str, Any]) -> str:
    """The table as the page prints it."""
    columns = ("cases", "triples", "no task", "yes", "no", "undecided", "no enclosure", "faulty")
    head = ("family", "cases", "triples", *columns[2:-1], "false", "median radius")
    rows = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for name, row in told["families"].items():
        values = [f"{row.get(column, 0):,}" for column in columns]
        rows.append(f"| {name} | " + " | ".join([*values, f"{row['radius']:.0e}"]) + " |")
    return "\n".join(rows)


def main() -> int:
    """Run, print what is false, and write what was found, also into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=260)
    parser.add_argument("--members", type=int, default=80)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--case", help="one case as SEED:INDEX: print it and what was found")
    parser.add_argument("--json", type=Path, default=RESULT)
    parser.add_argument("--page", type=Path, default=PAGE)
    given = parser.parse_args()
    if given.case:
        seed, index = map(int, given.case.split(":"))
        print(make(seed, index, given.members), one(seed, index, given.members), sep="\n")
        return 0
    found = []
    for line in lines(given.seed, given.cases, given.members, given.jobs):
        found.append(line)
        for fault in line.judged.faults:
            print(f"{given.seed}:{line.index} {line.family}: {fault}", flush=True)
        if len(found) % SAVED == 0 or len(found) == given.cases:
            told = {"seed": given.seed, "members": given.members, "families": table(found)}
            given.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    before, _, rest = given.page.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    given.page.write_text(f"{before}{BEGIN}\n\n{page(told)}\n\n{END}{after}", encoding="utf-8")
    whole = told["families"]["all"]
    print(page(told))
    print(f"slowest: {max(line.seconds for line in found):.1f} s of processor time")
    return int(whole["faulty"] > 0 or whole.get("no enclosure", 0) > OPEN * whole["cases"])


if __name__ == "__main__":
    sys.exit(main())
