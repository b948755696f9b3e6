"""What would help where no plan is found: relaxed problems that are planned and certified before they are named."""

from ensemble_ctrl.suggest.relax import Relaxation, Relaxed, relaxations
from ensemble_ctrl.suggest.search import SECONDS, Suggestion, Suggestions, suggest

__all__ = ["SECONDS", "Relaxation", "Relaxed", "Suggestion", "Suggestions", "relaxations", "suggest"]
