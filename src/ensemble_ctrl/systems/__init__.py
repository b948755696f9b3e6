"""Systems: the dynamics that every member of an ensemble shares."""

from ensemble_ctrl.systems.arrays import Arrays, sinc
from ensemble_ctrl.systems.unicycle import Unicycle

SYSTEMS = {Unicycle.name: Unicycle}
"""Every model by the name a problem file uses."""

__all__ = ["SYSTEMS", "Arrays", "Unicycle", "sinc"]
