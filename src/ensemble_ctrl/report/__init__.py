"""What a person reads: summary text and figures.  The only room that imports matplotlib, and only when drawing."""

from ensemble_ctrl.report.svg import map_svg
from ensemble_ctrl.report.text import summary_lines

__all__ = ["map_svg", "summary_lines"]
