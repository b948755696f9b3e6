"""The plan a user holds: controls with their problem, and verbs to replay, draw, save and load it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import isfinite
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.certificate import Certificate, certify
from ensemble_ctrl.core.errors import ProblemError, RunawayError, SolveError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.values import called, expect, number, numbers, path_of, whole
from ensemble_ctrl.files import planfile
from ensemble_ctrl.files.config import dump, load, load_text
from ensemble_ctrl.moments import Law
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.capabilities import supports
from ensemble_ctrl.problem.evaluation.arrival import arrival, risk
from ensemble_ctrl.problem.evaluation.conflicts import Conflict, conflicts
from ensemble_ctrl.problem.evaluation.sampled import Replay, replay

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from ensemble_ctrl.planning.planner import Progress, Solution, Status
    from ensemble_ctrl.planning.suggest import Suggestions

Floats = NDArray[np.float64]

STATUSES = ("planned", "infeasible", "limit", "interrupted")
"""How a search can end."""


@dataclass(frozen=True, eq=False)
class Plan(ReadOnlyArrays):
    """A broadcast control for the whole fleet, and what is known of it.

    Attributes
    ----------
    problem : Problem
        What was asked.
    controls : ndarray, shape (steps, n_u)
        Commands of every step, in the units of the system's controls; read-only.
    status : {"planned", "infeasible", "limit", "interrupted"}
        How the search ended. Only `replayed` and `certificate` say whether members are safe.
    details : dict
        What the search did: order, cost and its parts, iterations, routes, seconds.
    replayed : Replay or None
        The last replay that was run on this plan when it was made.
    certificate : Certificate or None
        What is proven of it for every parameter and instant, if that was asked for.
    twin : ndarray of shape (steps, n_u), or None
        Commands of the problem's unconstrained twin, for figures only; not saved.

    Notes
    -----
    *Guarantee*: none by itself; a plan is judged by `replay` and `certify`, never by the solver's word.
    """

    problem: Problem
    controls: Floats
    status: Status
    details: dict[str, Any] = field(default_factory=dict)
    replayed: Replay | None = None
    certificate: Certificate | None = None
    twin: Floats | None = None

    def __post_init__(self) -> None:
        expect("problem", self.problem, Problem)
        expect("details", self.details, dict)
        controls = numbers("controls", self.controls)
        wanted = (self.problem.steps, len(self.problem.fleet.system.controls))
        if controls.shape != wanted or not np.isfinite(controls).all():
            raise ProblemError(f"controls: expected {wanted} finite numbers, got shape {controls.shape}")
        if not isinstance(self.status, str) or self.status not in STATUSES:
            raise ProblemError(f"status: expected one of {', '.join(STATUSES)}, got {self.status!r}")
        controls.setflags(write=False)
        object.__setattr__(self, "controls", controls)

    @property
    def times(self) -> Floats:
        """Start of every step, seconds, shape (steps,)."""
        return self.problem.times[:-1]

    @property
    def verified(self) -> bool:
        """Whether a plan was found, no replayed member violates it, and its certificate, if any, says ``yes``."""
        replayed = self.replayed is not None and not self.replayed.violating.any()
        proven = self.certificate is None or self.certificate.proven == "yes"
        return self.status != "infeasible" and replayed and proven

    def replay(
        self,
        members: int | None = None,
        *,
        substeps: int | None = None,
        parameters: ArrayLike | Sequence[Mapping[str, float]] | None = None,
    ) -> Replay:
        """Run the controls on sampled members; see `ensemble_ctrl.problem.evaluation.sampled.replay`."""
        return replay(self.problem, self.controls, members=members, substeps=substeps, parameters=parameters)

    def certify(self, ranges: Mapping[str, Law] | None = None) -> Certificate:
        """Prove the plan for every member, or for one of other ranges; see `ensemble_ctrl.certificate`."""
        return certify(self.problem, self.controls, ranges)

    def conflicts(self) -> tuple[Conflict, ...]:
        """What fails, by how much, when and for whom; empty for a good plan."""
        return self._conflicts

    @cached_property
    def _conflicts(self) -> tuple[Conflict, ...]:
        """Found once: a failing plan's summary, page and files all ask."""
        return conflicts(self.problem, self.controls)

    def suggest(self, seconds: float = 30.0, *, progress: Progress | None = None) -> Suggestions:
        """Where no plan was found: a change of the problem with one; see `ensemble_ctrl.planning.suggest`."""
        from ensemble_ctrl.planning.suggest import suggest

        return suggest(self.problem, self.controls, seconds=number("seconds", seconds), progress=progress)

    def plot(self, kind: str = "trajectories", ax: Axes | None = None) -> Axes:
        """Draw one kind of picture; returns the axes and shows nothing.

        Parameters
        ----------
        kind : {"trajectories", "controls", "moments", "robustness", "clearance", "certificate"}
            What to draw. For a certificate the plan is certified if it is not yet.
        ax : matplotlib Axes, optional
            Where to; without it a new figure of pyplot's.

        Raises
        ------
        ProblemError
            For another kind.
        """
        from ensemble_ctrl.report.plot import draw

        needs = expect("kind", kind, str, "a kind of picture") == "certificate" and self.certificate is None
        return draw(replace(self, certificate=self.certify()) if needs else self, kind, ax)

    def animate(self, path: str | Path, seconds: float = 6.0) -> Path:
        """Write the fleet on its way as ``.gif``, or as ``.mp4`` where the program ffmpeg is installed.

        Parameters
        ----------
        path : path
            The file; written whole or not at all.
        seconds : float
            How long it runs, whatever the plan's own duration.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        AnimationError
            For another ending, a length that is none, and for a film without ffmpeg.
        """
        from ensemble_ctrl.report.animation import animate

        return animate(self.problem, self.controls, path_of("path", path), number("seconds", seconds))

    def to_dataframe(self, members: int = 0) -> DataFrame:
        """The table of `export` as a data frame; needs pandas.

        Parameters
        ----------
        members : int
            Members whose positions and headings are columns too, spread over the ranges of the parameters.

        Returns
        -------
        pandas.DataFrame
            One row for each step, its index the time of its beginning in seconds; with members one more row for the
            end, without commands.

        Raises
        ------
        UnsupportedError
            If pandas is not installed.
        """
        from ensemble_ctrl.files.export import frame

        return frame(self.problem, self.controls, whole("members", members, 0))

    def export(
        self,
        path: str | Path,
        form: str | None = None,
        *,
        members: int | None = None,
        overwrite: bool = False,
    ) -> Path:
        """Write the plan for other programs; see `ensemble_ctrl.files.export`.

        Parameters
        ----------
        path : path
            A file, or for a ROS 2 bag a folder.
        form : {"csv", "json", "geojson", "rosbag"}, optional
            The ending of `path` if not given.
        members : int, optional
            Members whose trajectories are written, spread over the ranges of the parameters.
        overwrite : bool
            Whether what is there may be replaced.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        ProblemError
            For an unknown form or a number of members out of range.
        UnsupportedError
            For ``rosbag`` without the library ``rosbags``.
        FolderError
            If the path is taken or can't be written.

        Notes
        -----
        *Guarantee*: what is proven of a plan is proven of robots that receive its commands. It says nothing of robots
        that follow one of the paths by a controller of their own.
        """
        from ensemble_ctrl.files.export import export

        path = path_of("path", path)
        form = path.suffix.removeprefix(".") if form is None else form
        export(self.problem, self.controls, self.certificate, form, path, members, overwrite)
        return path

    def save(self, path: str | Path) -> Path:
        """Write everything needed to load the plan again to one ``.npz`` file, without pickle.

        Parameters
        ----------
        path : path
            The file; ``.npz`` is added if it has no such ending.

        Returns
        -------
        Path
            The file written.
        """
        path = path_of("path", path)
        path = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        planfile.write(path, planfile.Saved(self.controls, dump(self.problem), self.status, self.details))
        return path

    @classmethod
    def load(cls, path: str | Path, *, trust: bool = False) -> Plan:
        """Read a plan that `save` wrote: a file, or a results folder that holds ``plan.npz``.

        Parameters
        ----------
        path : path
        trust : bool
            Whether to run the Python file of a user's own system, which has to lie next to the plan.

        Raises
        ------
        ProblemError
            If the file is missing or is not a plan.
        ConfigError
            If the problem in it is not one that this version reads.
        """
        path = planfile.path_of(path_of("path", path))
        saved = planfile.read(path)
        problem = load_text(saved.problem, f"{path}: problem", trust=trust)
        try:
            return cls(problem, saved.controls, cast("Status", saved.status), saved.details)
        except ProblemError as error:
            raise ProblemError(f"{path}: {error}") from None

    def __repr__(self) -> str:
        run, certificate = self.replayed, self.certificate
        checks = ["not replayed" if run is None else f"{int(run.violating.sum())} of {run.members} members violate"]
        checks += [] if certificate is None else [f"proven for all: {certificate.proven}"]
        cost = self.details.get("cost")
        worth = "" if cost is None else f", cost {cost:.4g}"
        return f"Plan({self.problem.name!r}: {self.status}{worth}, {self.problem.steps} steps, {', '.join(checks)})"

    def _repr_html_(self) -> str:
        from ensemble_ctrl.report import plan_card

        return plan_card(self)


def plan(
    problem: Problem | str | PathLike[str],
    *,
    progress: Progress | None = None,
    guess: Plan | Floats | None = None,
    log: str | Path | None = None,
    check: bool = True,
) -> Plan:
    """Find one broadcast control that does the task for the whole fleet, and replay it.

    Parameters
    ----------
    problem : Problem or path
        What to plan, or the problem file that says it.
    progress : callable, optional
        ``progress(phase, iteration or None) -> bool``; returning True stops with the best plan so far.
    guess : Plan or ndarray of shape (steps', n_u), optional
        Controls to start from instead of geometric routes.
    log : Path, optional
        File that the solver's own output is appended to.
    check : bool
        Whether to raise when no plan is found, or a replayed member violates it.

    Returns
    -------
    Plan
        Already replayed with ``problem.verify``, unless states run away under the controls found. Where a time is to
        be as short as possible, its problem is that of the time found, and ``details["soonest"]`` says what was
        tried (`ensemble_ctrl.planning.minimum_time.Soonest`).

    Raises
    ------
    SolveError
        With ``check``; the plan that fell short is its `plan`.

    Examples
    --------
    >>> import ensemble_ctrl as ec
    >>> problem = ec.load_text('''
    ... fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
    ... horizon: {duration: 4 s, steps: 20}
    ... regions: {goal: {box: [[1, 2], [-0.5, 0.5]]}}
    ... task: F[3, 4] in(goal)
    ... ''')
    >>> ec.plan(problem).replayed.satisfied
    1.0
    """
    from ensemble_ctrl.planning.minimum_time import solve

    began = perf_counter()
    if not isinstance(problem, Problem):
        problem = load(path_of("problem", problem, "a Problem, or the path of a file with one"))
    controls = guess.controls if isinstance(guess, Plan) else None if guess is None else numbers("guess", guess)
    file = None if log is None else path_of("log", log)
    if progress is not None:
        called("progress", progress)
    solution, soonest = solve(problem, progress=progress, guess=controls, log=file)
    if progress is not None:
        progress("replay", None)
    details = _details(solution) | ({} if soonest is None else {"soonest": asdict(soonest)})
    found = Plan(solution.problem, solution.controls, solution.status, details, None, solution.certificate)
    try:
        found = _replayed(found, began, progress)
    except RunawayError:
        known = {name: what for name, what in details.items() if name not in asdict(solution.attempt.value)}
        found = replace(found, status="infeasible" if found.status == "planned" else found.status, details=known)
    if check and not (found.status == "planned" and found.verified):
        raise SolveError(failure_message(found), found)
    return found


def _replayed(found: Plan, began: float, progress: Progress | None) -> Plan:
    """The plan with its replay, as far as that gets in what is left of the time, but at least in `AFTERWARDS`.

    After a wish to stop, that is all there is. A plan that fewer members ran than were asked for is not finished.
    """
    from ensemble_ctrl.ocp.solvers import AT_WORK
    from ensemble_ctrl.planning.planner import AFTERWARDS

    ends, stopped = max(began + found.problem.solve.time_limit, perf_counter() + AFTERWARDS), False

    def watch(_: int) -> bool:
        nonlocal stopped, ends
        if not stopped and progress is not None and progress("replay", AT_WORK):
            stopped, ends = True, min(ends, perf_counter() + AFTERWARDS)
        return perf_counter() > ends

    run = replay(found.problem, found.controls, watch=watch)
    cut = run.members < found.problem.verify.members and found.status == "planned"
    return replace(found, replayed=run, status="interrupted" if cut and stopped else "limit" if cut else found.status)


def failure_message(plan: Plan) -> str:
    """Why a plan falls short, in words: the constraints that conflict with amount, parameter and time."""
    from ensemble_ctrl.report import conflict_text
    from ensemble_ctrl.report.tried import tried

    lines = [conflict_text(c) for c in plan.conflicts()[:5]]
    lead = "no plan was found" if plan.status == "infeasible" else f"the plan falls short ({plan.status})"
    if plan.status == "planned" and not lines and plan.certificate is not None:
        why = plan.certificate.reason
        lead = "a plan was found that every replayed member does, but it is not proven" + (f" ({why})" if why else "")
    listed = "; violated near the best guess: " + "; ".join(lines) if lines else ""
    what = "; ".join(tried(plan.details))
    return f"{plan.problem.name}: {lead}{listed}" + (f"; tried: {what}" if what else "")


def checked(plan: Plan, run: Replay | None, certificate: Certificate | None) -> Plan:
    """The plan with another replay and certificate."""
    return replace(plan, replayed=run, certificate=certificate)


def with_twin(plan: Plan, progress: Progress | None = None) -> Plan:
    """The plan with the controls of its problem's unconstrained baseline, if there are any (`planning.baseline`)."""
    from ensemble_ctrl.planning.baseline import unconstrained
    from ensemble_ctrl.planning.planner import solve

    solution = solve(unconstrained(plan.problem), progress=progress)
    return replace(plan, twin=solution.controls if solution.status == "planned" else None)


def with_suggestions(plan: Plan, progress: Progress | None = None) -> Plan:
    """The plan with what would help in its details, where none was found and there is a second left to look for it."""
    from ensemble_ctrl.planning.suggest import SECONDS

    left = plan.problem.solve.time_limit - sum(plan.details.get("seconds", {}).values())
    over = plan.verified or plan.status not in ("infeasible", "limit") or left < 1
    if over or not supports(plan.problem, "suggest"):
        return plan
    found = plan.suggest(min(SECONDS, left), progress=progress)
    helps = [{"change": s.change, "set": list(s.overrides), "certified": True} for s in found.helps]
    tried = {"helps": helps, "failed": list(found.failed), "seconds": found.seconds}
    tried |= {"limited": True} if found.limited else {}
    return replace(plan, details={**plan.details, "suggestions": tried})


def _details(solution: Solution) -> dict[str, Any]:
    """What the search did, as plain data."""
    attempt = solution.attempt
    return {
        **{name: float(value) for name, value in asdict(attempt.value).items()},
        "orders": list(attempt.truncation.orders),
        "degrees": list(attempt.truncation.degrees),
        "guarantee": solution.problem.solve.guarantee,
        "solver": attempt.message,
        "iterations": solution.iterations,
        "build_seconds": solution.build_seconds,
        "solve_seconds": solution.solve_seconds,
        "seconds": solution.seconds,
        "arrival": _arrival(solution),
        "at_risk": risk(solution.problem, solution.controls),
        "missing": list(solution.missing),
        "routes": [{**vars(route), "corners": route.corners.tolist()} for route in solution.routes],
        **({} if solution.nlp is None else {"minlp": _mixed_details(solution.nlp.value.cost, solution)}),
    }


def _arrival(solution: Solution) -> dict[str, Any]:
    """How close the fleet comes to its target; nothing where it runs away."""
    try:
        return arrival(solution.problem, solution.controls)
    except RunawayError:
        return {}


def _mixed_details(nlp_cost: float, solution: Solution) -> dict[str, Any]:
    """What choosing facets anew did, as plain data; numbers that do not exist are None."""

    def number(value: float) -> float | None:
        return float(value) if isfinite(value) else None

    return {
        "nlp_cost": nlp_cost,
        "cost": solution.attempt.value.cost,
        "nodes": sum(r.nodes for r in solution.rounds),
        "rounds": [
            {
                "name": r.name,
                "status": r.status,
                "message": r.message,
                "cost_with_facets": number(r.cost),
                "cost": None if r.attempt is None else number(r.attempt.value.cost),
                "switches": r.binaries,
                "nodes": r.nodes,
                "objective": number(r.objective),
                "bound": number(r.bound),
                "gap": number(r.gap),
                "seconds": r.seconds,
                "kept": r.kept,
            }
            for r in solution.rounds
        ],
        "note": "Bonmin's gap is no proof of optimality: the problem is not convex, each node is solved to a local "
        "optimum, and only the offered facets were looked at.",
    }
