"""Run the problems of configs/ and write the gallery: ``python docs/make_gallery.py [--cluster local:N] [NAME ...]``.

Writes ``docs/_static/gallery/<name>.png`` (each below 80 KB), ``facts.json`` beside them, and ``docs/gallery.md``. Runs
the problems named, else every problem whose row is stale, because the problem or the code that plans and proves has
changed since. A row takes some seconds, all of them some minutes. What was run is kept in ``docs/_build`` until no
row is stale; before that the page is not written, and after an end in between the same command goes on.

Each row is a unit of `ensemble_ctrl.core.jobs` in a process of its own. One runs at a time, since some problems have a
time limit; ``--cluster local:2`` runs two.
"""

from __future__ import annotations

import argparse
import base64
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import printed
from printed import gallery

import ensemble_ctrl as ec
from ensemble_ctrl.core.jobs import Cluster, Outcome, outcomes
from ensemble_ctrl.files.examples import title

DOCS = Path(__file__).resolve().parent
CONFIGS = DOCS.parent / "configs"
PICTURES = DOCS / "_static" / "gallery"
FACTS = PICTURES / "facts.json"
WORK = DOCS / "_build" / "gallery"
"""What was run since the page was written."""
SECTIONS = {
    "": "Experiments of the paper",
    "minlp": "Facets chosen by Bonmin",
    "stl": "Benchmarks of stlpy, for a fleet",
    "fleets": "Several parameters, uncertain starts, bicycles",
    "vehicles": "Vehicles",
    "moving": "Moving obstacles",
    "maps": "Maps from other tools",
    "systems": "Other dynamics",
    "targets": "Targets of the whole fleet",
    "time": "As soon as possible",
    "uncertain": "Errors of the model",
    "sweeps": "Sweeps",
    "risk": "Risk, and a share of the fleet",
    "distributions": "Other distributions of the parameter",
}
"""Folders of `configs/` and their titles, in reading order."""
INTRO = """\
# Gallery

Every problem of `configs/`, run as it stands by `python docs/make_gallery.py`. *Certified* is the verdict of the
[certificate](guarantees.md) for every member of the fleet and every instant; *clearance* and *robustness* are the
proven bounds in metres, of the obstacles and of the rest of the task. Where a picture has dashed paths, they are
those of the same fleet with nothing in its way.
"""


def main(given: list[str]) -> None:
    """Run what is asked for, else what is stale, then write the page.

    Raises
    ------
    SystemExit
        If a problem fails, or a row is stale in the end.
    """
    parser = argparse.ArgumentParser(prog="make_gallery.py", description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="problems to run, else those whose row is stale")
    parser.add_argument("--cluster", type=Cluster.parse, default="local:1", help="local:N or tcp://HOST:PORT")
    options = parser.parse_args(given)
    kept = printed.read(WORK / "facts.json")
    facts = printed.read(FACTS) | kept
    wanted = [path for path in configs() if (path.stem in options.names if options.names else stale(path, facts))]
    failed = []
    for done in outcomes(map(gallery.unit_of, wanted), options.cluster):
        name = done.unit.name
        if done.failure:
            failed.append(done.failure)
            continue
        facts[name] = kept[name] = keep(done)
        print(name, facts[name], flush=True)
        printed.write(WORK / "facts.json", kept)
    if failed:
        raise SystemExit("\n".join(failed))
    publish(facts)


def keep(done: Outcome) -> dict[str, Any]:
    """Keep the picture of a row until the page is written; returns the row."""
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / f"{done.unit.name}.png").write_bytes(base64.b64decode(done.result["picture"]))
    row: dict[str, Any] = done.result["row"]
    return row


def stale(path: Path, facts: dict[str, Any]) -> bool:
    """Whether a problem's row is of other code or of another problem."""
    return bool(facts.get(path.stem, {}).get("source") != printed.source(path))


def publish(facts: dict[str, Any]) -> None:
    """Write the page, its figures and its pictures, unless a row is stale."""
    old = [path.stem for path in configs() if stale(path, facts)]
    if old:
        raise SystemExit(f"stale: {', '.join(old)}; run python docs/make_gallery.py again, the page is left as it was")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for picture in sorted(WORK.glob("*.png")):
        shutil.copyfile(picture, PICTURES / picture.name)
    printed.write(FACTS, {path.stem: facts[path.stem] for path in configs()})
    (DOCS / "gallery.md").write_text("\n".join(page(facts)) + "\n", encoding="utf-8")
    shutil.rmtree(WORK, ignore_errors=True)


def configs() -> list[Path]:
    """Every problem file, in reading order; those for loops and channels are on pages of their own."""
    words = ["one", "two", "three", "four", "five", "six", "seven", "eight", "nine"]

    def place(path: Path) -> tuple[int, int, str]:
        first = path.stem.split("_")[0]
        folder = "" if path.parent == CONFIGS else path.parent.name
        return list(SECTIONS).index(folder), words.index(first) + 1 if first in words else 0, path.stem

    return sorted(
        (path for path in CONFIGS.rglob("*.yaml") if path.parent.name not in ("online", "channels")), key=place
    )


def page(facts: dict[str, Any]) -> Iterator[str]:
    """The lines of the gallery."""
    yield INTRO
    yield "| problem | certified | clearance ≥ [m] | robustness ≥ [m] | exit code |"
    yield "|---|---|---|---|---|"
    shown = [path for path in configs() if path.stem in facts]
    for path in shown:
        found = facts[path.stem]
        numbers = ("–" if found[key] is None else f"{found[key]:.4f}" for key in ("clearance", "robustness"))
        name = f"[`{path.relative_to(CONFIGS.parent)}`](#{path.stem})"
        yield f"| {name} | {found['proven']} | {' | '.join(numbers)} | {found['exit']} |"
    for folder, heading in SECTIONS.items():
        here = [path for path in shown if path.parent.name == (folder or CONFIGS.name)]
        if here:
            yield from ("", f"## {heading}")
        for path in here:
            yield from entry(path)


def entry(path: Path) -> Iterator[str]:
    """One problem: its own words, its task and its picture."""
    task = " ".join(str(ec.load(path).task).split())
    words = title(path.read_text(encoding="utf-8"))
    yield from ("", f"### {path.stem}", "", f"{words}.", "", f"`{task}`", "")
    if (PICTURES / f"{path.stem}.png").exists():
        yield f"![{path.stem}](_static/gallery/{path.stem}.png)"


if __name__ == "__main__":
    main(sys.argv[1:])
