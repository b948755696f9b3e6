"""What a person reads: summary text and figures.  The only room that imports matplotlib, and only when drawing."""

from ensemble_ctrl.report.routes import route_lines
from ensemble_ctrl.report.text import conflict_text, summary_lines

__all__ = ["conflict_text", "route_lines", "summary_lines"]
