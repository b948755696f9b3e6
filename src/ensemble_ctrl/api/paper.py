"""The experiments of the paper (Arias et al., One Ring to Rule Them All), as published and in this package's form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf, isfinite
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.api.planning import plan
from ensemble_ctrl.api.plans import Plan
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.files.examples import example
from ensemble_ctrl.planning.planner import Progress
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.systems import Bicycle

Floats = NDArray[np.float64]
Form = Literal["published", "ours", "linear"]
Robot = Literal["unicycle", "bicycle"]

COUNTED = ("one", "three", "five", "six", "seven", "eight")
EXPERIMENTS = ("box", "polyhedron", *(f"{word}_obstacles" for word in COUNTED), "two_waypoints")
"""Examples that are the paper's experiments."""
ROBOTS: tuple[Robot, ...] = ("unicycle", "bicycle")
FORMS: tuple[Form, ...] = ("published", "ours", "linear")
"""The last is ours with a path and facets by a linear model (HiGHS), of unicycles among obstacles."""
MEMBERS, SUBSTEPS = 100_000, 10
"""Replayed members, and samples per step of each."""
ITERATIONS = 600
"""Of IPOPT, at most, for a published program: bicycles among eight obstacles need more than 300."""
TIME_LIMIT, LINEAR_LIMIT = 3600.0, 120.0
"""Seconds for one plan, and for facets by a linear model: iterations and nodes end them, the same on any machine."""
STEERING = 0.6
"""Largest steering angle of the bicycles, radians."""


@dataclass(frozen=True, eq=False)
class Reproduced:
    """One experiment with one kind of robots in one form.

    Attributes
    ----------
    experiment : str
        One of `EXPERIMENTS`.
    robot : str
        One of `ROBOTS`.
    form : {"published", "ours", "linear"}
    controls : ndarray, shape (steps, 2)
        The plan.
    status : str
        How the search ended; ``no solution`` where the published program has none within the limits.
    seconds : float
        Until the plan was found and certified, without replay, and without a run of Bonmin that found nothing.
    iterations : int
        Of IPOPT.
    cost : float
        Of the problem's objective with the worst member's robustness, the same for both forms.
    members : int
        Replayed members.
    violating : int
        Those that fail the task or enter an obstacle at one of `SUBSTEPS` times a step.
    depth : float
        By how much the worst member fails, metres; 0 if none does.
    proven : str
        The certificate's verdict on the plan, for every member and instant.
    truncation : float
        The largest distance between a member and the curve that moments up to the problem's order stand for, metres.
    facets : str
        Where the facets of the published form come from: ``Bonmin``, ``HiGHS``, or nothing where there are none.
    bonmin : str
        How Bonmin's run ended; empty without one.
    nodes : int
        Of Bonmin.
    bound, gap : float or None
        Of Bonmin, where it has them.
    """

    experiment: str
    robot: Robot
    form: Form
    controls: Floats
    status: str
    seconds: float
    iterations: int
    cost: float
    members: int
    violating: int
    depth: float
    proven: str
    truncation: float
    facets: str = ""
    bonmin: str = ""
    nodes: int = 0
    bound: float | None = None
    gap: float | None = None


def experiment(name: str, robot: Robot = "unicycle") -> Problem:
    """The problem of one experiment.

    Parameters
    ----------
    name : str
        One of `EXPERIMENTS`.
    robot : {"unicycle", "bicycle"}
        The bicycles have the unicycles' speeds and ranges, and steer by up to `STEERING`.

    Raises
    ------
    ProblemError
        If there is no such experiment or robot.

    Examples
    --------
    >>> experiment("box").order
    4
    """
    for what, given, known in (("experiment", name, EXPERIMENTS), ("robot", robot, ROBOTS)):
        if given not in known:
            raise ProblemError(f"{what}: expected one of {', '.join(known)}, got {given!r}")
    problem = example(name)
    problem = problem.with_(report=replace(problem.report, baseline=False, suggest=False))
    return problem if robot == "unicycle" else problem.with_(fleet=_steered(problem.fleet))


def _steered(fleet: Fleet) -> Fleet:
    """The same fleet of bicycles."""
    lower, upper = np.array([fleet.input_lower[0], -STEERING]), np.array([fleet.input_upper[0], STEERING])
    return fleet.with_(system=Bicycle(), input_lower=lower, input_upper=upper)


def as_published(problem: Problem, bonmin_limit: float = 10.0) -> Problem:
    """The problem in the paper's form: moments as variables, Runge-Kutta, moment rows, and all facets by Bonmin."""
    solve = replace(
        problem.solve,
        method="minlp",
        guarantee="moment",
        grid="full",
        facets="all",
        polish=False,
        margin=0.0,
        max_iterations=ITERATIONS,
        bonmin_limit=bonmin_limit,
        time_limit=TIME_LIMIT,
    )
    return problem.with_(coordinates="modal", integrator="rk4", solve=solve)


def with_linear_facets(problem: Problem) -> Problem:
    """The problem in our form, with another start: a path and facets by a linear model of the whole way."""
    return problem.with_(solve=replace(problem.solve, method="minlp", facets="linear", bonmin_limit=LINEAR_LIMIT))


def _is_tried(name: str, robot: Robot, form: Form) -> bool:
    """Whether an experiment is planned in a form."""
    problem = experiment(name, robot)
    if form not in FORMS:
        raise ProblemError(f"form: expected one of {', '.join(FORMS)}, got {form!r}")
    return form != "linear" or (robot == "unicycle" and bool(problem.obstacles))


def reproduce(
    experiments: Sequence[str] = EXPERIMENTS,
    robots: Sequence[Robot] = ROBOTS,
    members: int = MEMBERS,
    bonmin_limit: float = 10.0,
    forms: Sequence[Form] = FORMS,
    progress: Progress | None = None,
) -> tuple[Reproduced, ...]:
    """Plan the experiments in both forms, side by side on the cores there are, and replay and certify each plan.

    Parameters
    ----------
    experiments, robots : sequence of str
        Of `EXPERIMENTS` and `ROBOTS`.
    members : int
        Replayed.
    bonmin_limit : float
        Seconds that one run of Bonmin may take.
    forms : sequence of str
        Of `FORMS`.
    progress : callable, optional
        As for `ensemble_ctrl.plan`.

    Returns
    -------
    tuple of Reproduced
        Those that were finished, in order.
    """
    from ensemble_ctrl.ocp import parallel
    from ensemble_ctrl.ocp.solvers import Iteration, Watch

    every = [(name, robot, form) for name in experiments for robot in robots for form in forms]
    work = [what for what in every if _is_tried(*what)]

    def one(k: int, watch: Watch) -> Reproduced:
        name, robot, form = work[k]
        problem = experiment(name, robot)
        ways = {"published": as_published(problem, bonmin_limit), "linear": with_linear_facets(problem)}
        asked = ways.get(form, problem)
        return reproduced(problem, asked, work[k], members, partial(heard, watch))

    def tell(k: int, iteration: Iteration) -> bool:
        return progress is not None and progress(" ".join(work[k]), iteration)

    return tuple(row for row in parallel.each(one, len(work), tell, lambda: inf) if row is not None)


def heard(watch: Any, phase: str, iteration: Any) -> bool:
    """The planner's progress as iterations of one piece of work."""
    return iteration is not None and bool(watch(iteration))


def reproduced(
    problem: Problem, asked: Problem, what: tuple[str, Robot, Form], members: int, progress: Progress
) -> Reproduced:
    """One row: the plan of `asked`, judged by `problem`.

    Parameters
    ----------
    problem : Problem
        What the plan is judged by.
    asked : Problem
        The same in the form that is planned.
    what : tuple
        Experiment, robot and form.
    members : int
        Replayed.
    progress : callable
        As for `ensemble_ctrl.plan`.
    """
    from ensemble_ctrl.ocp.evaluate import evaluate
    from ensemble_ctrl.ocp.published.program import DEFAULT_ORDER
    from ensemble_ctrl.ocp.truncation import choose, plain, tail

    asked = asked.with_(verify=replace(asked.verify, members=members, substeps=SUBSTEPS))
    found = plan(asked, progress=progress, check=False)
    run = found.replayed
    assert run is not None
    shortest = min([run.worst[0], *(c.distance for c in run.clearances)])
    return Reproduced(
        *what,
        found.controls,
        "no solution" if _unsolved(found) else found.status,
        sum(found.details["seconds"].values()) - _fruitless(found),
        found.details["iterations"],
        evaluate(problem, found.controls, choose(problem, found.controls)).cost,
        run.members,
        int(run.violating.sum()),
        max(0.0, -shortest),
        (found.certificate or certify(problem, found.controls)).proven,
        tail(problem, found.controls, plain((problem.order or DEFAULT_ORDER,), hull=False)),
        **_bonmin(found),
    )


def _unsolved(found: Plan) -> bool:
    """Whether no solver found a solution of the published program; the plan then is where they began."""
    rounds = found.details.get("minlp", {}).get("rounds", ())
    return found.problem.solve.as_published and all(one["cost"] is None for one in rounds)


def _fruitless(found: Plan) -> float:
    """Seconds of a run of Bonmin from which the plan does not come."""
    rounds = found.details.get("minlp", {}).get("rounds", ())
    return float(sum(one["seconds"] for one in rounds if one["name"] == "all facets" and not one["kept"]))


def _bonmin(found: Plan) -> dict[str, Any]:
    """Where the facets come from, and how far Bonmin got."""
    rounds = {one["name"]: one for one in found.details.get("minlp", {}).get("rounds", ())}
    if "all facets" not in rounds:
        return {}
    run = rounds["all facets"]
    kept = {"facets": "Bonmin" if run["kept"] else "HiGHS", "bonmin": run["message"]}
    return kept | {name: run[name] for name in ("nodes", "bound", "gap")}


def as_data(row: Reproduced) -> dict[str, Any]:
    """One row as plain data, without its controls."""
    data = {name: value for name, value in vars(row).items() if name != "controls"}
    return {name: None if isinstance(v, float) and not isfinite(v) else v for name, v in data.items()}


def table(rows: Sequence[Reproduced]) -> list[str]:
    """The experiments as text, a line each."""
    lines = [
        f"{'experiment':<17}{'robot':<10}{'form':<11}{'time':>8}{'iterations':>12}{'cost':>10}{'violating':>18}"
        f"{'worst depth':>13}  {'proven':<9}facets"
    ]
    for row in rows:
        share = f"{row.violating} ({100 * row.violating / max(row.members, 1):.1f} %)"
        lines.append(
            f"{row.experiment:<17}{row.robot:<10}{row.form:<11}{row.seconds:>6.1f} s{row.iterations:>12}"
            f"{row.cost:>10.4f}{share:>18}{row.depth:>11.4f} m  {row.proven:<9}{row.facets}"
        )
    return lines


__all__ = [
    "EXPERIMENTS",
    "FORMS",
    "MEMBERS",
    "ROBOTS",
    "SUBSTEPS",
    "Reproduced",
    "as_data",
    "as_published",
    "experiment",
    "reproduce",
    "reproduced",
    "table",
    "with_linear_facets",
]
