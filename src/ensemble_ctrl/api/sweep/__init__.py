"""Sweeps: many problems from axes in a problem file, or from many files, and a row of facts for each."""

from ensemble_ctrl.api.sweep.rows import Sweep
from ensemble_ctrl.api.sweep.sweep import Progress, run, sweep

__all__ = ["Progress", "Sweep", "run", "sweep"]
