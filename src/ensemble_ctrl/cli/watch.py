"""``--watch``: a page that shows live what a command does, served by a process beside it."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from ensemble_ctrl.cli.progress import Progress
from ensemble_ctrl.cli.streams import complain
from ensemble_ctrl.core.errors import RunawayError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ensemble_ctrl.api.plans import Plan
    from ensemble_ctrl.constraints import Obstacle
    from ensemble_ctrl.ocp.candidates import Start
    from ensemble_ctrl.ocp.solvers import Iteration
    from ensemble_ctrl.planning.online.driver import Loop, Outcome
    from ensemble_ctrl.planning.online.step import Step
    from ensemble_ctrl.problem import Problem

    Floats = NDArray[np.float64]

PROGRAM = (
    "import json, sys; descriptor, token, path = json.loads(sys.argv[1]); sys.path[:] = path; "
    "from ensemble_ctrl.api.edit.watching import main; main(descriptor, token)"
)
"""What the page's process runs; it finds modules where the command does, and nowhere else."""
OFTEN = 0.1
"""Seconds between two iterations that are shown."""
KEPT = 500
"""Iterations that a page which is opened later is told of."""
PATIENCE = 5.0
"""Seconds in which the page's process has to end."""
MEMBERS = 7
"""Members of the first plan that are drawn below a loop."""


class Watch:
    """A page of a command that goes on.

    Parameters
    ----------
    mode : {"search", "loop"}
        What is shown.
    problem : Problem
        Its map is below everything.
    browser : bool
        Whether to open it.

    Raises
    ------
    EnsembleError
        If a library is missing.
    """

    def __init__(self, mode: str, problem: Problem, browser: bool) -> None:
        # loaded where there is a page only: the command without one begins sooner
        import subprocess
        import webbrowser

        from ensemble_ctrl.cli.edit import open_page

        with open_page("--watch") as sock:
            from ensemble_ctrl.api.edit.guard import new_token
            from ensemble_ctrl.api.edit.scene import ground, scene
            from ensemble_ctrl.api.edit.serving import address_of

            token, drawn = new_token(), scene(problem)
            given = json.dumps([sock.fileno(), token, sys.path])
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", PROGRAM, given],
                stdin=subprocess.PIPE,
                pass_fds=(sock.fileno(),),
                start_new_session=True,  # Ctrl-C is for the command, which ends it
            )
            address = address_of(sock, token)
        shown = ground(problem, drawn["views"][0]["areas"])
        self.publish({"mode": mode, "file": problem.name, "map": shown, "scene": drawn})
        complain(f"watch: {address}")
        if browser:
            webbrowser.open(address)

    def publish(self, event: dict[str, Any]) -> None:
        """Tell the page; what is not finite is nothing there, and a page that has ended is no reason to fail."""
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):
            self._process.stdin.write(json.dumps(_plain(event), allow_nan=False).encode() + b"\n")
            self._process.stdin.flush()

    def end(self, stay: bool) -> None:
        """No more will come; if the page may `stay`, wait until it is closed, or for Ctrl-C."""
        self.publish({"kind": "done"})
        if stay and self._process.poll() is None:
            complain("the page stays until it is closed; Ctrl-C ends it")
            with suppress(KeyboardInterrupt):
                self._process.wait()
        self.close()

    def close(self) -> None:
        """End the page's process."""
        import subprocess

        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


class Shown(Progress):
    """Progress that is shown on a page, too.

    Parameters
    ----------
    quiet, verbose : bool
        As for `Progress`.

    Attributes
    ----------
    page : Watch or None
        None until it is known what is shown.
    """

    def __init__(self, quiet: bool = False, verbose: bool = False) -> None:
        super().__init__(quiet, verbose)
        self.page: Watch | None = None
        self._began, self._last, self._count = time.perf_counter(), -OFTEN, 0

    def __call__(self, phase: str, iteration: Iteration | None) -> bool:
        """Take note of a phase or an iteration."""
        seconds = time.perf_counter() - self._began
        if self.page is not None and iteration is None:
            self.page.publish({"kind": "phase", "phase": phase, "seconds": seconds})
        elif self.page is not None and iteration is not None and seconds - self._last >= OFTEN:
            self._last, self._count = seconds, self._count + 1
            facts = {"count": iteration.count, "cost": iteration.cost, "violation": iteration.violation}
            slot = {"slot": f"iteration {self._count % KEPT}"}
            self.page.publish({"kind": "iteration", "phase": phase, "seconds": seconds, **facts, **slot})
        return super().__call__(phase, iteration)

    def candidates(self, found: Sequence[Start]) -> None:
        """Guesses, or what became of them so far."""
        if self.page is not None:
            self.page.publish({"kind": "candidates", "slot": "candidates", "found": [_candidate(one) for one in found]})

    def planned(self, plan: Plan) -> None:
        """The end of a search."""
        if self.page is None:
            return
        from ensemble_ctrl.api.edit.drawing import drawing
        from ensemble_ctrl.report.html import verdict_class
        from ensemble_ctrl.report.text import verdict

        drawn = None
        with suppress(RunawayError):  # nothing can be drawn of a fleet that leaves all bounds
            drawn = drawing(plan)
        facts = {"verdict": verdict(plan), "class": verdict_class(plan), "drawing": drawn}
        self.page.publish({"kind": "plan", "slot": "plan", **facts})

    def tell(self, event: Callable[[], dict[str, Any]]) -> None:
        """Show something, where there is a page."""
        if self.page is not None:
            self.page.publish(event())


@contextmanager
def shown(quiet: bool = False, verbose: bool = False) -> Iterator[Shown]:
    """Within: progress that may have a page; the page stays afterwards, unless someone wanted to stop."""
    progress = Shown(quiet, verbose)
    try:
        yield progress
        if progress.page is not None:
            progress.page.end(progress.stop_signal is None)
    finally:
        if progress.page is not None:
            progress.page.close()


def first_event(problem: Problem, controls: Floats) -> dict[str, Any]:
    """Where a fleet goes under the plan that a loop begins with."""
    from ensemble_ctrl.problem.evaluation.sampled import trajectories

    ways = trajectories(problem, controls, problem.fleet.spread(MEMBERS), 1)
    return {"kind": "first", "slot": "first", "ways": ways.tolist(), "step": problem.step}


class Steps:
    """The steps of a loop as events: where every robot may be and is to go, what is known and what is proven.

    Parameters
    ----------
    problem : Problem
        Whose map the page has from the beginning.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._told: dict[str, int] = {}

    def __call__(self, loop: Loop, step: Step) -> dict[str, Any]:
        """The event of one step; of the past, each place is told once, with its time and the radius of its set."""
        grid = loop.problem.step
        return {
            "kind": "step",
            "time": step.begin * grid,
            "end": step.end * grid,
            "step": grid,
            "source": step.source,
            "proof": step.proof,
            "clearance": step.clearance,
            "robustness": step.robustness,
            "ranges": step.ranges,
            "seconds": step.seconds,
            "deadline": loop.options.deadline,
            "events": list(step.events),
            "robots": self._robots(loop),
            "obstacles": self._obstacles(loop),
        }

    def end(self, loop: Loop, outcome: Outcome) -> dict[str, Any]:
        """The event of the end."""
        facts = {"ending": outcome.ending, "reason": outcome.reason, "step": loop.problem.step}
        return {"kind": "outcome", **facts, "robots": self._robots(loop), "obstacles": self._obstacles(loop)}

    def _robots(self, loop: Loop) -> dict[str, Any]:
        """Of each robot, the places that were not told yet, and where it is to go from when on."""
        grid, robots = loop.problem.step, {}
        for name, tracker in loop.trackers.items():
            begin, end = self._told.get(name, 0), len(tracker.past)
            new = [(k * grid, tracker.past[k]) for k in range(begin, end)]
            robots[name] = {
                "past": [{"time": time, "at": known.position.tolist(), "away": known.away} for time, known in new],
                "from": (end - 1) * grid,
                "ahead": loop.predicted(name).tolist(),
            }
            self._told[name] = end
        return robots

    def _obstacles(self, loop: Loop) -> dict[str, Any]:
        """What is elsewhere on the map than the page has it: where it is predicted now, and how far off it may be.

        Obstacles that are gone have no outlines.
        """
        now = max(len(tracker.past) - 1 for tracker in loop.trackers.values()) * loop.problem.step
        before, found = self._problem.obstacles, {}
        for name, pieces in loop.problem.obstacles.items():
            motion = loop.problem.motions.get(name)
            if motion is not None:
                found[name] = {"away": motion.loose(now), "outlines": _outlines(pieces, motion.at(now))}
            elif before.get(name) is not pieces:
                found[name] = {"away": 0.0, "outlines": _outlines(pieces, np.zeros(pieces[0].vertices.shape[1]))}
        gone = {name: {"away": 0.0, "outlines": {}} for name in before if name not in loop.problem.obstacles}
        return found | gone


def _outlines(pieces: Sequence[Obstacle], offset: Floats) -> dict[str, Any]:
    """Pieces displaced by `offset`, by the pairs of coordinates of the views that show them."""
    from ensemble_ctrl.problem.drawing import shadow
    from ensemble_ctrl.report.map_content import VIEWS

    corners = [piece.vertices + offset for piece in pieces]
    views = VIEWS.get(len(offset), ())
    return {f"{i},{j}": [shadow(one, (i, j)).tolist() for one in corners] for i, j in views}


def _candidate(one: Start) -> dict[str, Any]:
    """A guess, or what became of it, as plain data."""
    return {
        "name": one.name,
        "kind": one.kind,
        "length": one.length,
        "corners": one.corners.tolist(),
        "outcome": getattr(one, "outcome", "at work"),
        "cost": getattr(one, "cost", None),
    }


def _plain(data: Any) -> Any:
    """The same with None for numbers that are not finite."""
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if isinstance(data, float | np.floating):
        return float(data) if np.isfinite(data) else None
    return data
