"""An enclosure for any smooth system: polynomials in time and parameters, with a proven bound of their error.

It uses the system's own `xdot`, called on intervals and on polynomials with a remainder in place of numbers, and shares
no code with the optimiser or the replay. The theorem and its proof are in ``docs/proof_systems.md``.
"""

from ensemble_ctrl.certificate.general.enclosure import Enclosure, enclose

__all__ = ["Enclosure", "enclose"]
