"""Proof that a plan is good for every parameter value and every instant.

`certify` takes a problem and controls and nothing of how they were found; it shares no code with the optimiser's
constraints or transcription.
"""

from ensemble_ctrl.certificate.bound import Bound, CounterExample
from ensemble_ctrl.certificate.certify import PROOFS, Certificate, Proof, certify, unproven
from ensemble_ctrl.certificate.record import EFFORT, as_data, claim, differences
from ensemble_ctrl.certificate.task import TaskBound

__all__ = [
    "EFFORT",
    "PROOFS",
    "Bound",
    "Certificate",
    "CounterExample",
    "Proof",
    "TaskBound",
    "as_data",
    "certify",
    "claim",
    "differences",
    "unproven",
]

TRUSTED = tuple(
    f"ensemble_ctrl.{room}{module}"
    for room, modules in {
        "certificate.": (
            *(
                "apart",
                "bodies",
                "bound",
                "boxes",
                "certify",
                "chords",
                "clearance",
                "commands",
                "disturbance",
                "enclosure",
            ),
            *(
                "errors",
                "fingerprint",
                "instants",
                "masses",
                "schedule",
                "share",
                "signals",
                "starts",
                "task",
                "terrain",
            ),
        ),
        "constraints.": (
            *("_rows", "_sides", "cover", "disc", "exact", "obstacle", "partition", "polygon", "polyhedron", "solid"),
        ),
        "constraints.stl.": ("_hints", "_text", "_tokens", "formula", "implied", "leaves", "rewrite"),
        "core.": ("errors", "plain", "readonly", "values"),
        "problem.": ("signals", "specification", "starts", "zones"),
    }.items()
    for module in modules
)
"""The modules that have to be right for *yes* to be true of robots on arcs: all that `certify` reaches by imports."""

GENERAL = tuple(
    f"ensemble_ctrl.certificate.general.{module}"
    for module in (
        *("proof", "start", "enclosure", "basis", "models", "smooth", "gradients", "growth", "boxes", "lines"),
        *("clearance", "task", "jacobian", "disturbed"),
    )
)
"""Those that have to be right, too, for *yes* to be true of other systems."""

HANDED = tuple(
    f"ensemble_ctrl.{room}{module}"
    for room, modules in {
        "constraints.": ("footprint", "motion"),
        "problem.": ("arc_members", "ensemble", "fleet", "problem", "terrain", "uncertainty"),
        "systems.": ("arcs", "bicycle", "unicycle"),
        "moments.": ("distribution", "measure", "samples", "normal", "beta", "mixture"),
    }.items()
    for module in modules
)
"""Where the objects are defined that a problem hands to these modules: see *How a proof could still be wrong*."""
