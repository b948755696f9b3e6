"""What would help where no plan is found: relaxed problems that are planned and certified before they are named."""

from ensemble_ctrl.planning.suggest.relax import Relaxation, Relaxed, relaxations
from ensemble_ctrl.planning.suggest.search import SECONDS, Suggestion, Suggestions, suggest

__all__ = ["SECONDS", "Relaxation", "Relaxed", "Suggestion", "Suggestions", "relaxations", "suggest"]
