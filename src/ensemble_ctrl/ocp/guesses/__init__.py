"""Further guesses for searches that geometric routes did not lead to a plan: curved paths, and perturbed commands."""
