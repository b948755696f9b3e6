"""Run the campaign: ``python -m tests.campaign.run --cases 50000 --seed 0 --jobs 2``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

from .cases import make
from .judge import judge
from .table import Line, Table, printed

CHUNK = 100
"""Cases that a process is handed at a time."""
SAVED = 1000
"""Cases after which the table is written."""


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


def main() -> int:
    """The command; its exit code is 1 if a claim is false or too much is left open."""
    parser = argparse.ArgumentParser(description="Judge certificates of random and hostile cases by an oracle.")
    parser.add_argument("--cases", type=int, default=50_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--case", help="one case as SEED:INDEX: print it and what was found")
    parser.add_argument("--show", type=int, default=20, help="how many false claims are printed")
    parser.add_argument("--out", type=Path, help="a JSON file for the table")
    parser.add_argument("--page", type=Path, help="a page of the documentation whose table is written anew")
    args = parser.parse_args()
    if args.case:
        seed, index = map(int, args.case.split(":"))
        case = make(seed, index)
        print(case, judge(case), sep="\n")
        return 0
    found, shown = Table(args.seed), 0
    for line in all_lines(args.seed, args.cases, args.jobs):
        found.add(line)
        for fault in line.faults if shown < args.show else ():
            shown += 1
            print(f"{args.seed}:{line.index} {line.family} {line.verdict}: {fault['kind']}: {fault['what'][:300]}")
        if args.out and (found.cases % SAVED == 0 or found.cases == args.cases):
            args.out.write_text(found.as_json())
    print(found.as_markdown())
    if args.page:
        args.page.write_text(printed(args.page.read_text(), found.as_markdown()))
    return int(found.is_bad)


if __name__ == "__main__":
    sys.exit(main())
