"""Proof that a plan is good for every parameter value and every instant.

`certify` takes a problem and controls and nothing of how they were found; it shares no code with the optimiser's
constraints or transcription.
"""

from ensemble_ctrl.certificate.certify import Certificate, CounterExample, certify
from ensemble_ctrl.certificate.clearance import Bound
from ensemble_ctrl.certificate.record import as_data, claim, differences
from ensemble_ctrl.certificate.task import TaskBound

__all__ = ["Bound", "Certificate", "CounterExample", "TaskBound", "as_data", "certify", "claim", "differences"]
