"""How much error of the model a plan tolerates, and plans that tolerate most."""

from ensemble_ctrl.planning.tolerance.measure import Tolerance, Tolerated, measure
from ensemble_ctrl.planning.tolerance.search import MostTolerant, solve

__all__ = ["MostTolerant", "Tolerance", "Tolerated", "measure", "solve"]
