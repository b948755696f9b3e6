"""Run the problems of configs/ and write the gallery: ``python docs/make_gallery.py [NAME ...]``.

Writes ``docs/_static/gallery/<name>.png`` (each below 80 KB), ``facts.json`` beside them, and ``docs/gallery.md``. Runs
the problems named, else every problem whose row is stale, because the problem or the code that plans and proves has
changed since. A row takes some seconds, all of them some minutes. What was run is kept in ``docs/_build`` until no
row is stale; before that the page is not written, and after an end in between the same command goes on.
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import printed
from PIL import Image

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.files.examples import title

DOCS = Path(__file__).resolve().parent
CONFIGS = DOCS.parent / "configs"
PICTURES = DOCS / "_static" / "gallery"
FACTS = PICTURES / "facts.json"
WORK = DOCS / "_build" / "gallery"
"""What was run since the page was written."""
LARGEST = 80_000
"""Bytes of one picture."""
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


def main(names: list[str]) -> None:
    """Run what is asked for, else what is stale, then write the page.

    Raises
    ------
    SystemExit
        If a problem fails, or a row is stale in the end.
    """
    kept = printed.read(WORK / "facts.json")
    facts = printed.read(FACTS) | kept
    for path in configs():
        if path.stem in names if names else stale(path, facts):
            facts[path.stem] = kept[path.stem] = run(path)
            print(path.stem, facts[path.stem], flush=True)
            printed.write(WORK / "facts.json", kept)
    publish(facts)


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


def run(path: Path) -> dict[str, Any]:
    """Plan one problem with the command; returns what is proven, and writes its picture.

    Raises
    ------
    SystemExit
        If the command fails; a problem without a plan still leaves its best attempt.
    """
    before = printed.source(path)
    with TemporaryDirectory() as folder:
        results = Path(folder) / "results"
        command = [sys.executable, "-m", "ensemble_ctrl.cli", "run", str(path), "-o", str(results), "-q"]
        ended = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        if not (results / "plan.npz").exists():
            raise SystemExit(f"{path}: exit code {ended.returncode}\n{ended.stderr}")
        plan = ec.Plan.load(results)
        WORK.mkdir(parents=True, exist_ok=True)
        shrink(results / "trajectories.png", WORK / f"{path.stem}.png")
    certificate = certify(plan.problem, plan.controls)
    return {
        "source": before,
        "exit": ended.returncode,
        "cost": plan.details["cost"],
        "proven": certificate.proven,
        "clearance": printed.rounded_down(certificate.clearance) if certificate.clearances else None,
        "robustness": printed.rounded_down(certificate.robustness) if certificate.parts else None,
    }


def shrink(source: Path, target: Path) -> None:
    """A picture of few colours, made smaller until it is below `LARGEST`."""
    picture = Image.open(source).convert("RGB")
    for width in (720, 640, 560, 480, 400):
        size = (width, round(width * picture.height / picture.width))
        small = picture.resize(size, Image.Resampling.LANCZOS).quantize(200, dither=Image.Dither.NONE)
        data = io.BytesIO()
        small.save(data, "PNG", optimize=True)
        if len(data.getvalue()) < LARGEST:
            break
    target.write_bytes(data.getvalue())


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
