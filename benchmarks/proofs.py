"""Time plans and proofs of systems that are defined by an ODE: ``python benchmarks/proofs.py``.

Takes, for each problem file, the processor's time of all that planning needs but for the certificate, that of the
certificate alone, and the largest radius of the position in its enclosure; keeps them for docs/proof_systems.md.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from record import record

import ensemble_ctrl as ec
from ensemble_ctrl.certificate.general.proof import GeneralProof

ROOT = Path(__file__).parents[1]
FILES = (*sorted((ROOT / "configs" / "systems").glob("*.yaml")), ROOT / "examples" / "own_system.yaml")


def spent() -> float:
    """Seconds of the processor for this process and its children that have ended."""
    return sum(os.times()[:4])


def timed(path: Path) -> dict[str, Any]:
    """One problem file."""
    problem = ec.load(path, trust=True)
    began = spent()
    plan = ec.plan(problem)
    planned, begin = spent() - began, time.process_time()
    certificate = plan.certify()
    proven = time.process_time() - begin
    enclosure = GeneralProof(plan.problem, plan.controls, plan.problem.fleet.parameters).enclosure
    radius = float(enclosure.radius[:, plan.problem.fleet.place_columns].max())
    name = str(path.relative_to(ROOT))
    return {"name": name, "plan": planned, "proof": proven, "radius": radius, "proven": certificate.proven}


if __name__ == "__main__":
    rows = []
    for file in FILES:
        rows.append(timed(file))
        print(rows[-1], flush=True)
    record("proofs", rows)
