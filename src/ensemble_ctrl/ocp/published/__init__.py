"""The optimal-control problems of the paper as they are printed, on the moments, row by row.

Nothing here is used to plan unless it is asked for: these rows are necessary for the fleet, not sufficient.
"""

from ensemble_ctrl.ocp.published.equations import Equations, PublishedTask
from ensemble_ctrl.ocp.published.program import PublishedProgram, published_program

__all__ = ["Equations", "PublishedProgram", "PublishedTask", "published_program"]
