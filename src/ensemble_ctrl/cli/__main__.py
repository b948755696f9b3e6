"""``python -m ensemble_ctrl.cli`` is the command ``ensemble-plan``."""

from ensemble_ctrl.cli import main

main()
