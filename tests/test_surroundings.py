"""Plans do not depend on what is around: threads, event loops, switches of the interpreter; huge texts are no harm."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

import ensemble_ctrl as ec

TEXT = """
fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
horizon: {duration: 2 s, steps: 8}
obstacles: {post: {box: [[0.3, 0.4], [0.2, 0.3]]}}
task: F[1, 2] x >= 0.4 and G avoid(post)
verify: {members: 10}
"""


@cache
def controls() -> np.ndarray:
    """Of the plan in the main thread."""
    return ec.plan(ec.load_text(TEXT)).controls


def test_a_thread_and_an_event_loop_give_equal_controls() -> None:
    found: list[ec.Plan] = []
    thread = Thread(target=lambda: found.append(ec.plan(ec.load_text(TEXT))))
    thread.start()
    thread.join()

    async def planned() -> ec.Plan:
        return await asyncio.to_thread(ec.plan, ec.load_text(TEXT))

    for plan in (found[0], asyncio.run(planned())):
        np.testing.assert_allclose(plan.controls, controls(), atol=1e-6)


def test_optimised_strict_narrow_and_homeless(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(TEXT)
    kept = {name: value for name, value in os.environ.items() if name in ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH")}
    command = [sys.executable, "-O", "-W", "error", "-m", "ensemble_ctrl", "run", "a.yaml", "-o", "out", "--no-plots"]
    run = subprocess.run(
        command, cwd=tmp_path, env={**kept, "LC_ALL": "C", "COLUMNS": "40"}, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert "Warning" not in run.stderr
    np.testing.assert_allclose(ec.Plan.load(tmp_path / "out").controls, controls(), atol=1e-6)


def test_huge_texts_are_read_or_refused_in_a_line() -> None:
    assert ec.parse("(" * 10_000 + "x >= 0" + ")" * 10_000) == ec.parse("x >= 0")
    for task in (f"x >= {'1' * 900_000}", f"G[0, {'1' * 900_000}] x >= 0", "not " * 10_001 + "x >= 0"):
        with pytest.raises(ec.ProblemError) as refusal:
            ec.parse(task)
        assert len(str(refusal.value)) < 200
