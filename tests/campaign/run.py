"""Run the campaign: ``python -m tests.campaign.run --cases 50000 --seed 0 --jobs 2``."""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .cases import make
from .judge import judge

CHUNK = 100


@dataclass(frozen=True)
class Line:
    """One case in short."""

    index: int
    family: str
    verdict: str
    decided: str
    seconds: float
    faults: tuple[dict[str, Any], ...]


def lines(seed: int, indices: Iterable[int]) -> list[Line]:
    """Some cases, judged."""
    return [_line(seed, index) for index in indices]


def _line(seed: int, index: int) -> Line:
    """One case, judged."""
    began = time.perf_counter()
    case = make(seed, index)
    try:
        judged = judge(case)
    except Exception as error:
        raise RuntimeError(f"the oracle can't judge case {seed}:{index}: {error!r}") from error
    return Line(
        index,
        case.family,
        judged.verdict,
        judged.decided,
        time.perf_counter() - began,
        tuple(asdict(fault) for fault in judged.faults),
    )


def all_lines(seed: int, cases: int, jobs: int) -> Iterator[Line]:
    """Every case, in order."""
    chunks = [range(first, min(first + CHUNK, cases)) for first in range(0, cases, CHUNK)]
    if jobs == 1:
        for chunk in chunks:
            yield from lines(seed, chunk)
        return
    with ProcessPoolExecutor(jobs) as pool:
        for done in pool.map(lines, [seed] * len(chunks), chunks):
            yield from done


def table(found: Iterable[Line]) -> dict[str, dict[str, Any]]:
    """Counts for each family, and for all."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    worst: dict[str, float] = defaultdict(float)
    for line in found:
        for name in (line.family, "all"):
            count = counts[name]
            count["cases"] += 1
            count[line.verdict] += 1
            count["decidable"] += bool(line.decided) and line.verdict in ("yes", "no", "undecided")
            count["left open"] += bool(line.decided) and line.verdict == "undecided"
            for kind in {fault["kind"] for fault in line.faults}:
                count[kind] += 1
            worst[name] = max([worst[name], *(fault["excess"] for fault in line.faults)])
    return {name: {**count, "worst": worst[name]} for name, count in counts.items()}


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=50_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--case", help="one case as SEED:INDEX: print it and what was found")
    parser.add_argument("--show", type=int, default=20, help="how many false claims are printed")
    parser.add_argument("--out", type=Path, help="a JSON file for the table")
    args = parser.parse_args()
    if args.case:
        seed, index = map(int, args.case.split(":"))
        case = make(seed, index)
        print(case)
        print(judge(case))
        return
    began = time.perf_counter()
    found = list(all_lines(args.seed, args.cases, args.jobs))
    faulty = [line for line in found if line.faults]
    for line in faulty[: args.show]:
        for fault in line.faults:
            print(f"{args.seed}:{line.index} {line.family} {line.verdict}: {fault['kind']}: {fault['what'][:300]}")
    rows = table(found)
    for name, row in rows.items():
        print(name, row)
    print(f"{time.perf_counter() - began:.0f} s, slowest", max(found, key=lambda line: line.seconds))
    if args.out:
        args.out.write_text(json.dumps({"seed": args.seed, "cases": args.cases, "table": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
