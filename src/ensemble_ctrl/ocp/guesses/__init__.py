"""First guesses: routes around obstacles at once; curves, and commands with waves, where these led to no good plan."""

from ensemble_ctrl.ocp.guesses.curved import CurvedGuesses
from ensemble_ctrl.ocp.guesses.laid_out import LaidOutGuesses
from ensemble_ctrl.ocp.guesses.perturbed import PerturbedGuesses
from ensemble_ctrl.ocp.guesses.registry import GUESSES, Guess, Request, Source, first_guesses, further_guesses
from ensemble_ctrl.ocp.guesses.roadmap import RoadmapGuesses
from ensemble_ctrl.ocp.guesses.state_guesses import StateGuesses

GUESSES.update(
    {
        "itinerary": LaidOutGuesses(),
        "roadmap": RoadmapGuesses(),
        "states": StateGuesses(),
        "curved": CurvedGuesses(),
        "waves": PerturbedGuesses(),
    }
)

__all__ = ["GUESSES", "Guess", "Request", "Source", "first_guesses", "further_guesses"]
