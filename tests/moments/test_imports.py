"""The room stays light."""

from __future__ import annotations

import subprocess
import sys


def test_the_room_imports_numpy_only() -> None:
    names = "ensemble_ctrl.moments, sys; heavy = {'scipy', 'casadi', 'matplotlib', 'yaml'}"
    code = f"import {names}; print(sorted(heavy & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
