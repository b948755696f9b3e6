"""Many independent pieces of work, on processes of this machine or on a Dask cluster, each of them once.

A piece (`Unit`) is a pure function of (kind, hash of its content, index): what it gives does not depend on which worker
computes it, on what that one did before, or on how many there are. Finished pieces are kept in a file of JSON lines
(`Checkpoint`), so that after the end of a worker, of the scheduler or of this process a rerun computes the rest only.
"""

from ensemble_ctrl.core.jobs.checkpoint import Checkpoint
from ensemble_ctrl.core.jobs.cluster import Cluster
from ensemble_ctrl.core.jobs.engine import outcomes
from ensemble_ctrl.core.jobs.unit import DEATHS, Content, Outcome, Unit

__all__ = ["DEATHS", "Checkpoint", "Cluster", "Content", "Outcome", "Unit", "outcomes"]
