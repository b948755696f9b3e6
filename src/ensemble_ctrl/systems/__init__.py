"""Systems: the dynamics that every member of an ensemble shares."""

from ensemble_ctrl.systems.arcs import DRIVE, ArcSystem
from ensemble_ctrl.systems.arrays import Arrays, sinc
from ensemble_ctrl.systems.bicycle import Bicycle
from ensemble_ctrl.systems.double_integrator import DoubleIntegrator
from ensemble_ctrl.systems.ode import OdeSystem
from ensemble_ctrl.systems.planar_quadrotor import PlanarQuadrotor
from ensemble_ctrl.systems.quadrotor import Quadrotor
from ensemble_ctrl.systems.unicycle import Unicycle

SYSTEMS: dict[str, type[ArcSystem]] = {Unicycle.name: Unicycle, Bicycle.name: Bicycle}
"""Every model that moves on arcs by the name a problem file uses."""

ODE_SYSTEMS: dict[str, type[OdeSystem]] = {
    system.name: system for system in (DoubleIntegrator, PlanarQuadrotor, Quadrotor)
}
"""Every model that is defined by an ODE by the name a problem file uses."""

__all__ = [
    "DRIVE",
    "ODE_SYSTEMS",
    "SYSTEMS",
    "ArcSystem",
    "Arrays",
    "Bicycle",
    "DoubleIntegrator",
    "OdeSystem",
    "PlanarQuadrotor",
    "Quadrotor",
    "Unicycle",
    "sinc",
]
