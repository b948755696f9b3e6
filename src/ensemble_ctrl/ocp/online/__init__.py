"""The optimal-control problem solved again and again while time goes on (`program`)."""

from ensemble_ctrl.ocp.online.model import InitialCondition
from ensemble_ctrl.ocp.online.program import OnlineProgram, Replan, Timer

__all__ = ["InitialCondition", "OnlineProgram", "Replan", "Timer"]
