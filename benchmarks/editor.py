"""How soon the editor shows a new proof: random drags of obstacles of ``configs/five_obstacles.yaml`` in a browser.

``python benchmarks/editor.py --drags 200`` prints the share of new proofs that are drawn within a second of letting go,
and how long the check of a changed text takes.  Drags after which nothing is proven are counted apart.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from ensemble_ctrl.files.config import read_text  # noqa: E402
from tests.edit.editor import Editor, editor  # noqa: E402
from tests.report.browser import Page, chromium, executable  # noqa: E402

FAR = 60
"""Pixels of a drag in each direction, at most: about 0.6 m."""
WAIT = 20.0
"""Seconds after which a drag counts as without a proof."""
SHOWN = "document.documentElement.dataset"
PLACE = (
    "(() => { const r = document.querySelector('[data-name=\"%s\"] polygon').getBoundingClientRect();"
    " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
)
TICK = os.sysconf("SC_CLK_TCK")


def processor(one: Editor) -> float:
    """Seconds of processor time of the editor and of its workers, with what those have started and waited for."""
    total = 0
    for pid in [one.process.pid, *one.children()]:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        total += sum(map(int, fields[11:15]))
    return total / TICK


def drag(tab: Page, one: Editor, draw: random.Random) -> dict[str, Any]:
    """One drag: seconds from letting go to the new proof, or why there is none; then back."""
    name = draw.choice(["o1", "o2", "o3", "o4", "o5"])
    x, y = tab.run(PLACE % name)
    before = processor(one)
    tab.run(f"delete {SHOWN}.drawn; delete {SHOWN}.dropped")
    tab.drag((x, y), (x + draw.uniform(-FAR, FAR), y + draw.uniform(-FAR, FAR)), 6)
    end, found = time.monotonic() + WAIT, None
    while found is None and time.monotonic() < end:
        time.sleep(0.01)
        found = tab.run(
            f"{SHOWN}.dropped && editor.map.dragged === null ? {SHOWN}.fresh === 'yes' && editor.plan.drawing.proven "
            f"? Math.max(0, {SHOWN}.drawn - {SHOWN}.dropped) / 1000 : editor.state.valid ? null : 'invalid' : null"
        )
    used = processor(one) - before
    tab.run("editor.changes.send('/api/step/undo')")
    return {"obstacle": name, "seconds": found, "processor": used}


def check_seconds(draws: int = 50) -> float:
    """Processor seconds of one check of the text, the median."""
    text = (ROOT / "configs" / "five_obstacles.yaml").read_text(encoding="utf-8")
    found = []
    for _ in range(draws):
        began = time.process_time()
        read_text(text)
        found.append(time.process_time() - began)
    return sorted(found)[draws // 2]


def measured(count: int, seed: int) -> list[dict[str, Any]]:
    """All drags."""
    browser = executable()
    if browser is None:
        raise SystemExit("no headless Chromium here")
    draw = random.Random(seed)
    with TemporaryDirectory() as folder:
        file = Path(shutil.copy(ROOT / "configs" / "five_obstacles.yaml", folder))
        with editor(file) as one, chromium(browser) as tab:
            tab.screen(1280, 900)
            tab.visit(one.address)
            while tab.run(f"{SHOWN}.fresh") != "yes":
                time.sleep(0.1)
            return [drag(tab, one, draw) for _ in range(count)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drags", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args(arguments)
    rows = measured(asked.drags, asked.seed)
    if asked.json:
        print(json.dumps(rows))
        return
    proven = sorted(row["seconds"] for row in rows if isinstance(row["seconds"], float | int))
    invalid = sum(row["seconds"] == "invalid" for row in rows)
    soon = sum(seconds <= 1.0 for seconds in proven)
    used = sorted(row["processor"] for row in rows)
    print(f"{len(rows)} drags: {len(proven)} proven, {invalid} onto the start or beyond, the rest without a proof")
    if proven:
        print(f"drawn within 1.0 s of letting go: {soon} ({100 * soon / len(proven):.1f} %)")
        middle, late = proven[len(proven) // 2], proven[int(0.95 * len(proven))]
        print(f"median {middle:.2f} s, 95 % {late:.2f} s, most {proven[-1]:.2f} s")
    print(f"processor time of a drag with its plans: median {used[len(used) // 2]:.2f} s")
    print(f"check of a changed text: {1000 * check_seconds():.1f} ms of processor time")


if __name__ == "__main__":
    main()
