"""The command ``ensemble-plan``; `main` is its entry point."""

from __future__ import annotations

import gc


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; see `ensemble_ctrl.cli.app`."""
    gc.set_threshold(250_000)  # starting makes many objects that stay: to look through them over and over frees nothing
    from ensemble_ctrl.cli.app import main as run

    run(arguments)


__all__ = ["main"]
