"""One row of the gallery, as a unit of work: a problem is planned as the command does it, and proven again."""

from __future__ import annotations

import base64
import io
import json
from contextlib import redirect_stderr
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.cli.app import invoke
from ensemble_ctrl.core.jobs import Content, Unit
from printed import rounded_down, source

LARGEST = 80_000
"""Bytes of one picture."""


def unit_of(path: Path) -> Unit:
    """The row of one problem; another problem or other code is another unit."""
    about = {"path": str(path.resolve()), "source": source(path)}
    return Unit(__name__, Content(json.dumps(about)), name=path.stem, alone=True)


def prepare(text: str) -> dict[str, str]:
    """What a unit is about."""
    about: dict[str, str] = json.loads(text)
    return about


def run(about: dict[str, str], index: int) -> dict[str, Any]:
    """Plan one problem with the command.

    Returns
    -------
    dict
        ``row``, which is what is proven; and the ``picture``, a PNG file in base 64.

    Raises
    ------
    RuntimeError
        If the command writes no results; a problem without a plan still leaves its best attempt.
    """
    with TemporaryDirectory() as folder, redirect_stderr(io.StringIO()) as said:
        results = Path(folder) / "results"
        code = invoke(["run", about["path"], "-o", str(results), "-q"])
        if not (results / "plan.npz").exists():
            raise RuntimeError(f"exit code {code}\n{said.getvalue()}")
        plan = ec.Plan.load(results)
        picture = shrunk(results / "trajectories.png")
    certificate = certify(plan.problem, plan.controls)
    row = {
        "source": about["source"],
        "exit": code,
        "cost": plan.details["cost"],
        "proven": certificate.proven,
        "clearance": rounded_down(certificate.clearance) if certificate.clearances else None,
        "robustness": rounded_down(certificate.robustness) if certificate.parts else None,
    }
    return {"row": row, "picture": base64.b64encode(picture).decode()}


def shrunk(file: Path) -> bytes:
    """A picture of few colours, made smaller until it is below `LARGEST`."""
    picture = Image.open(file).convert("RGB")
    for width in (720, 640, 560, 480, 400):
        size = (width, round(width * picture.height / picture.width))
        small = picture.resize(size, Image.Resampling.LANCZOS).quantize(200, dither=Image.Dither.NONE)
        data = io.BytesIO()
        small.save(data, "PNG", optimize=True)
        if len(data.getvalue()) < LARGEST:
            break
    return data.getvalue()
