"""The command ``ensemble-plan``; `main` is its entry point."""

from ensemble_ctrl.cli.app import main

__all__ = ["main"]
