"""Run the campaign: ``python -m tests.campaign.features.run --cases 300``."""

from __future__ import annotations

import argparse
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np

from .cases import make
from .judge import Judged, judge
from .world import Featured


def judged(seed: int, cases: range) -> Iterator[tuple[int, Featured, Judged]]:
    """Some cases with what is false of their certificates."""
    for index in cases:
        case = make(seed, index)
        try:
            found = judge(case, np.random.default_rng([seed, index, 1]))
        except Exception as error:
            raise RuntimeError(f"case {seed}:{index} of {case.base.family} broke off: {error!r}") from error
        yield index, case, found


def main() -> int:
    """The command; its exit code is 1 if a claim is false."""
    parser = argparse.ArgumentParser(description="Judge certificates of later features by robots at their bounds.")
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", help="one case as SEED:INDEX: print it and what was found")
    args = parser.parse_args()
    if args.case:
        seed, index = map(int, args.case.split(":"))
        for _, case, found in judged(seed, range(index, index + 1)):
            print(case, found, sep="\n")
        return 0
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for index, case, found in judged(args.seed, range(args.first, args.first + args.cases)):
        counts[case.base.family][found.verdict] += 1
        counts[case.base.family]["false"] += bool(found.faults)
        print(
            *(f"{args.seed}:{index} {case.base.family} {found.verdict}: {what[:300]}" for what in found.faults),
            sep="\n",
            end="",
        )
    _print(counts)
    return int(any(row["false"] for row in counts.values()))


def _print(counts: dict[str, Any]) -> None:
    """A line for each family."""
    print()
    for name, row in counts.items():
        print(
            f"{name:10s} " + ", ".join(f"{row[what]} {what}" for what in ("yes", "no", "undecided", "refused", "false"))
        )


if __name__ == "__main__":
    sys.exit(main())
