"""``python -m ensemble_ctrl`` is the command ``ensemble-plan``."""

from ensemble_ctrl.cli import main

if __name__ == "__main__":
    main()
