"""What of a problem is not for a loop."""

from __future__ import annotations

from collections.abc import Iterator

from ensemble_ctrl.constraints.stl import reads_fleet
from ensemble_ctrl.constraints.stl.leaves import Avoid
from ensemble_ctrl.constraints.stl.rewrite import ALL_OBSTACLES, leaves
from ensemble_ctrl.planning.online.mapped import with_map
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.capabilities import FEATURES, supports
from ensemble_ctrl.problem.checks import Finding
from ensemble_ctrl.problem.checks.motion import moving_elsewhere
from ensemble_ctrl.problem.checks.support import dimension_findings
from ensemble_ctrl.problem.signals import signals_read
from ensemble_ctrl.problem.specification import AvoidThroughout


def loop_findings(problem: Problem) -> Iterator[Finding]:
    """What of a problem is not for a loop, which drives one robot on arcs for a time that is given."""
    if not (found := supports(problem, "online")):
        yield Finding(FEATURES["online"].path, found.message, found.hint)
    if reads_fleet(problem.task):
        message = f"a loop drives one robot, and this speaks of the whole fleet: {problem.task}"
        yield Finding(("task",), message, "say what the robot has to do")
    if problem.zones:
        message = "zones are not for a loop: its proofs know the obstacles and the task"
        yield Finding(("zones",), message, "write areas to keep out of as obstacles")
    elif signals := signals_read(problem):
        message = f"the proofs of a loop are about positions, and the task is about {', '.join(signals)}"
        yield Finding(("task",), message, "plan it as a whole, without online")
    yield from _findings_of_errors(problem)
    yield from _findings_of_starts(problem)
    yield from _findings_of_obstacles(problem)
    if problem.least_duration is not None:
        yield Finding(("horizon", "duration"), "a free duration is not for a loop", "give one, 16 s say")
    if problem.objective.earliest is not None:
        message = "the earliest passage is not for a loop"
        yield Finding(("objective", "earliest"), message, "give the visit a window in the task")
    if not problem.fleet.system.on_arcs:
        yield from _findings_of_states(problem)
    elif problem.online is not None and problem.online.options.states:
        message = f"errors of single states are not for a loop of the {problem.fleet.system.name}"
        yield Finding(("online", "states"), message, "use noise")


def _findings_of_errors(problem: Problem) -> Iterator[Finding]:
    """Errors of the model that the sets of a loop do not count."""
    bounds, path = problem.fleet.uncertainty, ("fleet", "uncertainty")
    if bounds and not problem.fleet.system.on_arcs:
        message = f"a loop of the {problem.fleet.system.name} does not count errors of the model"
        yield Finding(path, message, "loops of robots on arcs do")


def _findings_of_starts(problem: Problem) -> Iterator[Finding]:
    """Starts that no robot has."""
    starts, system = problem.fleet.starts, problem.fleet.system
    if not starts:
        return
    if not system.on_arcs or problem.solve.as_published:
        yield Finding(("fleet", "starts"), "several starts are for loops with proofs of robots on arcs")
    elif problem.online is not None and set(problem.online.robots) != set(starts):
        wanted = f"expected a robot for each of fleet.starts, {', '.join(starts)}"
        yield Finding(("online",), f"{wanted}, got {', '.join(problem.online.robots)}", "give online.robots")


def _findings_of_obstacles(problem: Problem) -> Iterator[Finding]:
    """Obstacles that come while the loop runs, where they cannot be counted."""
    coming = {} if problem.online is None else problem.online.obstacles
    system = problem.fleet.system
    for name, each in coming.items():
        path = ("online", "obstacles", name)
        if not system.on_arcs or problem.solve.as_published:
            loop = "the published loop" if system.on_arcs else f"a loop of the {system.name}"
            yield Finding(path, f"obstacles that come on the way are not for {loop}", "give them under obstacles")
        elif name in problem.obstacles or name in problem.regions:
            yield Finding(path, f"expected a new name, got {name!r}, which the map has", on_key=True)
        elif not any(_avoids_all(part) for part in problem.specification.always):
            message = "expected a part of the task that avoids it, such as G avoid(obstacles)"
            yield Finding(path, f"{message}, got {problem.task}", on_key=True)
        else:
            alone = with_map(problem, {name: each.pieces}, {} if each.motion is None else {name: each.motion})
            for wrong in dimension_findings(alone):
                yield Finding((*path, "motion") if "motions" in wrong.path else path, wrong.message, on_key=True)
            yield from moving_elsewhere(alone)


def _avoids_all(part: AvoidThroughout) -> bool:
    """Whether a part avoids every obstacle, those that will be seen too."""
    return any(isinstance(leaf, Avoid) and leaf.name == ALL_OBSTACLES for leaf in leaves(part.written))


def _findings_of_states(problem: Problem) -> Iterator[Finding]:
    """What is not for the loop of a system that an ODE defines: it knows no standing, and no error of the model."""
    fleet, settings = problem.fleet, problem.online
    name = fleet.system.name
    if fleet.rate_bounds is not None:
        yield Finding(("fleet", "rate_bounds"), f"bounds on the rates of commands are not for a loop of the {name}")
    if settings is None:
        return
    errors = settings.options.errors
    if errors.drift:
        yield Finding(("online", "drift"), f"a drift is not for a loop of the {name}", "its sets know no model error")
    if settings.options.horizon == "receding":
        why = f"a receding horizon is not for a loop of the {name}: its safety is a plan proven to the end"
        yield Finding(("online", "horizon"), why, "use shrinking")
    if len(settings.robots) > 1:
        yield Finding(("online", "robots"), f"several robots are not for a loop of the {name}", "give one robot")
