"""Systems: the dynamics that every member of an ensemble shares."""

from ensemble_ctrl.systems.arcs import DRIVE, ArcSystem
from ensemble_ctrl.systems.arrays import Arrays, sinc
from ensemble_ctrl.systems.bicycle import Bicycle
from ensemble_ctrl.systems.differential_drive import DifferentialDrive
from ensemble_ctrl.systems.double_integrator import DoubleIntegrator
from ensemble_ctrl.systems.mecanum import Mecanum
from ensemble_ctrl.systems.planar_quadrotor import PlanarQuadrotor
from ensemble_ctrl.systems.quadrotor import Quadrotor
from ensemble_ctrl.systems.single_integrator import SingleIntegrator
from ensemble_ctrl.systems.system import OdeSystem, System
from ensemble_ctrl.systems.trailer import Trailer
from ensemble_ctrl.systems.unicycle import Unicycle

SYSTEMS: dict[str, type[System]] = {
    system.name: system
    for system in (
        Unicycle,
        Bicycle,
        DifferentialDrive,
        Mecanum,
        Trailer,
        SingleIntegrator,
        DoubleIntegrator,
        PlanarQuadrotor,
        Quadrotor,
    )
}
"""Every model by the name that a problem file uses."""

__all__ = [
    "DRIVE",
    "SYSTEMS",
    "ArcSystem",
    "Arrays",
    "Bicycle",
    "DifferentialDrive",
    "DoubleIntegrator",
    "Mecanum",
    "OdeSystem",
    "PlanarQuadrotor",
    "Quadrotor",
    "SingleIntegrator",
    "System",
    "Trailer",
    "Unicycle",
    "sinc",
]
