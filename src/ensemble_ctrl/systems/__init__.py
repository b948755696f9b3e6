"""Systems: the dynamics that every member of an ensemble shares."""

from ensemble_ctrl.systems.arcs import DRIVE, ArcSystem
from ensemble_ctrl.systems.arrays import Arrays, sinc
from ensemble_ctrl.systems.bicycle import Bicycle
from ensemble_ctrl.systems.unicycle import Unicycle

SYSTEMS: dict[str, type[ArcSystem]] = {Unicycle.name: Unicycle, Bicycle.name: Bicycle}
"""Every model by the name a problem file uses."""

__all__ = ["DRIVE", "SYSTEMS", "ArcSystem", "Arrays", "Bicycle", "Unicycle", "sinc"]
