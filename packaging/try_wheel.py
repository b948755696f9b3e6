"""Build the wheel, install it into a clean environment outside of the repository, and use it as a user would.

``python packaging/try_wheel.py`` needs Python 3.11 or later and nothing else.  It fails if the wheel lacks a file: the
main job is planned and proven, every packaged example is checked, and a saved plan is verified.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from venv import create

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = "Scripts" if sys.platform == "win32" else "bin"
COPY = """\
import ensemble_ctrl as ec
from ensemble_ctrl.cli.app import invoke
assert not any([invoke(["examples", name, "--copy"]) for name in ec.examples()])
"""


def main() -> None:
    """Build, install, run."""
    with TemporaryDirectory() as folder:
        place = Path(folder)
        python = place / "venv" / SCRIPTS / "python"
        create(place / "venv", with_pip=True)
        _run(place, python, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", place, ROOT)
        (wheel,) = place.glob("*.whl")
        _run(place, python, "-m", "pip", "install", "--quiet", wheel)
        command = python.with_name("ensemble-plan")
        _run(place, python, "-c", COPY)
        _run(place, command, "check", "-q", *sorted(place.glob("*.yaml")))
        _run(place, command, "init")
        _run(place, command, "problem.yaml", "--quiet")
        _run(place, command, "verify", "plans/problem")
        _run(place, command, "five_obstacles.yaml", "--quiet")
        print(f"{wheel.name}: installs and runs on Python {sys.version.split()[0]}")


def _run(place: Path, *words: object) -> None:
    """One command in a folder of its own; its failure is ours."""
    print("$", *words, flush=True)
    subprocess.run([str(word) for word in words], cwd=place, check=True)


if __name__ == "__main__":
    main()
