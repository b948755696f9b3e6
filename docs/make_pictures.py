"""Plan ``configs/five_obstacles.yaml`` and make the README's animation and the figures of ``docs/report.md``.

``python docs/make_pictures.py`` writes ``docs/_static/five_obstacles.gif``, ``figures.png`` and, of
``configs/uncertain/muddy_yard.yaml``, ``muddy_yard.png``. ``report.png`` there is
a picture of the page in a browser, taken by hand.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

import ensemble_ctrl as ec
from ensemble_ctrl.api.planning import with_baseline
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.report.plot import write_plot

DOCS = Path(__file__).parent
KINDS = ("trajectories", "robustness", "clearance", "certificate")
GAP = 50


def main() -> None:
    """Make all."""
    plan = ec.plan(ec.load(DOCS.parent / "configs" / "five_obstacles.yaml"))
    plan.animate(DOCS / "_static" / "five_obstacles.gif")
    figures(with_baseline(replace(plan, certificate=plan.certify())), DOCS / "_static" / "figures.png")
    yard(DOCS / "_static" / "muddy_yard.png")


def yard(path: Path) -> None:
    """A plan round mud and over gravel, in few colours."""
    plan = ec.plan(ec.load(DOCS.parent / "configs" / "uncertain" / "muddy_yard.yaml"))
    with TemporaryDirectory() as folder:
        drawn = Image.open(write_plot(plan, "trajectories", Path(folder) / "trajectories.png")).convert("RGB")
    small = drawn.resize((900, round(900 * drawn.height / drawn.width)), Image.Resampling.LANCZOS)
    small.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)


def figures(plan: Plan, path: Path) -> None:
    """Four kinds of pictures, two by two, in few colours."""
    with TemporaryDirectory() as folder:
        drawn = [Image.open(write_plot(plan, kind, Path(folder) / f"{kind}.png")).convert("RGB") for kind in KINDS]
    width, heights = drawn[0].width, [max(drawn[k].height, drawn[k + 1].height) for k in (0, 2)]
    sheet = Image.new("RGB", (2 * width + GAP, sum(heights) + GAP), "white")
    for k, picture in enumerate(drawn):
        sheet.paste(picture, ((k % 2) * (width + GAP), (k // 2) * (heights[0] + GAP)))
    small = sheet.resize((1000, round(1000 * sheet.height / sheet.width)), Image.Resampling.LANCZOS)
    small.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main()
