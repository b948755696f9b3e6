"""Plans as files for other programs: tables, JSON, GeoJSON, ROS 2 bags.

What is proven of a plan is proven of its broadcast commands. The paths in these files are those of sampled robots of
the model; a robot that follows one by a controller of its own no longer receives the commands, and nothing is proven
of it.
"""

from ensemble_ctrl.files.export.members import Members, sampled
from ensemble_ctrl.files.export.table import frame
from ensemble_ctrl.files.export.write import FORMATS, MEMBERS, export

__all__ = ["FORMATS", "MEMBERS", "Members", "export", "frame", "sampled"]
