"""Run the campaign: ``python -m tests.campaign.loops.run --loops 2000 --jobs 2``."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tests.paths import ROOT

from .configs import FILES, judge_file
from .controls import CONTROLS
from .judge import Judged, judge
from .scene import late, make
from .swarms import judge_swarm
from .tables import rewrite

RESULTS = Path(__file__).parent / "results.json"
PAGE = ROOT / "docs" / "online_proof.md"
CHUNK = 10
SWARM = 20
"""One loop in so many is a swarm."""
LATE = 10
"""One loop in so many is of robots that are late, or on terrain."""
PATIENCE = 400
"""Loops after which a margin that was taken out counts as not caught."""


@dataclass(frozen=True)
class Line:
    """One loop in short."""

    index: int
    judged: Judged | None


def one(seed: int, index: int) -> Line:
    """The loop of a number; a loop that breaks off is a fault of the package."""
    scene = late(seed, index) if index % LATE == LATE - 3 else make(seed, index)
    try:
        return Line(index, judge_swarm(scene) if index % SWARM == SWARM - 1 else judge(scene))
    except Exception as error:
        raise RuntimeError(f"loop {seed}:{index} broke off: {error!r}") from error


def some(seed: int, indices: Iterable[int]) -> list[Line]:
    """Some loops, judged."""
    return [one(seed, index) for index in indices]


def file(path: Path, seed: int) -> Judged:
    """A file of `configs/online`, judged."""
    with tempfile.TemporaryDirectory() as folder:
        return judge_file(path, seed, Path(folder))


def caught(name: str, seed: int, most: int) -> tuple[int, list[str]] | None:
    """How many loops it takes until a margin that was taken out is seen, and by what; None if it isn't."""
    with CONTROLS[name]():
        for index in range(most):
            found = judge(make(seed, index))
            if found is not None and found.faults:
                return index + 1, sorted({fault.kind for fault in found.faults})
    return None


def table(found: Iterable[Judged]) -> dict[str, dict[str, int]]:
    """Counts for each family, and for all."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for each in found:
        for name in (each.family, "all"):
            counts[name]["loops"] += 1
            counts[name][each.ending] += 1
            counts[name]["checks"] += each.checks
            counts[name]["faulty"] += bool(each.faults)
            for proof, number in each.proofs.items():
                counts[name][f"steps proven {proof}"] += number
    return {name: dict(sorted(counts[name].items())) for name in sorted(counts)}


@dataclass
class Found:
    """What a campaign has found so far."""

    judged: list[Judged] = field(default_factory=list)
    refused: int = 0
    faults: list[dict[str, Any]] = field(default_factory=list)
    controls: dict[str, Any] = field(default_factory=dict)

    def add(self, name: str, judged: Judged | None) -> None:
        """One loop."""
        if judged is None:
            self.refused += 1
            return
        self.judged.append(judged)
        for fault in judged.faults:
            self.faults.append({"loop": name, "family": judged.family, **asdict(fault)})
            print(f"{name}, {judged.family}: {fault}", flush=True)

    def margin(self, name: str, found: tuple[int, list[str]] | None) -> None:
        """One margin that was taken out."""
        self.controls[name] = None if found is None else {"loops": found[0], "by": found[1]}
        print(f"without a margin, {name}: {self.controls[name]}", flush=True)


def campaign(seed: int, loops: int, jobs: int, seconds: float) -> Found:
    """Files, margins and loops; no loop begins after so many seconds."""
    found, began = Found(), time.monotonic()
    with ProcessPoolExecutor(jobs) as pool:
        files = {path.stem: pool.submit(file, path, seed) for path in FILES}
        margins = {name: pool.submit(caught, name, seed, PATIENCE) for name in CONTROLS}
        chunks = [range(first, min(first + CHUNK, loops)) for first in range(0, loops, CHUNK)]
        some_ = [pool.submit(some, seed, chunk) for chunk in chunks]
        for each in as_completed(some_):
            for line in () if each.cancelled() else each.result():
                found.add(f"loop {seed}:{line.index}", line.judged)
            print(f"\r{len(found.judged)}/{loops}", end="", file=sys.stderr, flush=True)
            if time.monotonic() - began > seconds:
                for later in some_:
                    later.cancel()
        for name, file_ in files.items():
            found.add(name, file_.result())
        for name, margin in margins.items():
            found.margin(name, margin.result())
    return found


def main() -> int:
    """Run, print what is wrong, and write what was found, also into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="no loop begins after so long")
    parser.add_argument("--json", type=Path, default=RESULTS)
    parser.add_argument("--page", type=Path, default=PAGE)
    given = parser.parse_args()
    began = time.monotonic()
    found = campaign(given.seed, given.loops, given.jobs, 60 * given.minutes)
    told = {
        "seed": given.seed,
        "refused": found.refused,
        "families": table(found.judged),
        "controls": found.controls,
        "faults": sorted(found.faults, key=lambda fault: str(fault["loop"])),
    }
    given.json.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    rewrite(given.page, told)
    print(f"{len(found.judged)} loops in {time.monotonic() - began:.0f} s, {len(found.faults)} faults")
    return 1 if found.faults or None in found.controls.values() else 0


if __name__ == "__main__":
    sys.exit(main())
