"""First guesses: routes around obstacles at once; other kinds where these led to no plan."""

from ensemble_ctrl.ocp.guesses.curved import CurvedGuesses
from ensemble_ctrl.ocp.guesses.laid_out import RoutedGuesses
from ensemble_ctrl.ocp.guesses.perturbed import PerturbedGuesses
from ensemble_ctrl.ocp.guesses.pivoting import PivotedGuesses
from ensemble_ctrl.ocp.guesses.registry import GUESSES, Guess, Request, Source, first_guesses, further_rounds
from ensemble_ctrl.ocp.guesses.state_guesses import StateGuesses
from ensemble_ctrl.ocp.guesses.state_trees import StateTreeGuesses
from ensemble_ctrl.ocp.guesses.trees import TreeGuesses
from ensemble_ctrl.ocp.guesses.warped import WarpedGuesses

GUESSES.update(
    {
        "routes": RoutedGuesses(),
        "states": StateGuesses(),
        "pivots": PivotedGuesses(),
        "curved": CurvedGuesses(),
        "timing": WarpedGuesses(),
        "trees": TreeGuesses(),
        "state trees": StateTreeGuesses(),
        "waves": PerturbedGuesses(),
    }
)

__all__ = ["GUESSES", "Guess", "Request", "Source", "first_guesses", "further_rounds"]
