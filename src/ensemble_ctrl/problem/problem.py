"""The planning problem as frozen data: a fleet, a horizon, a map, a task and what to minimise."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import Motion
from ensemble_ctrl.constraints.stl import Formula
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays, ReadOnlyMapping
from ensemble_ctrl.core.renamed import renamed_fields
from ensemble_ctrl.core.values import expect, flag, known_only, numbers
from ensemble_ctrl.problem.arguments import mapping_of, names_of, obstacles_of, quantity_of, regions_of, task_of
from ensemble_ctrl.problem.arguments.fleets import frozen
from ensemble_ctrl.problem.fleet import Fleet
from ensemble_ctrl.problem.risk import Risk
from ensemble_ctrl.problem.specification import Specification
from ensemble_ctrl.problem.starts import Pair
from ensemble_ctrl.problem.target import Formation, MomentTarget, SpreadTarget, Target
from ensemble_ctrl.problem.terrain import Patch, terrain_data
from ensemble_ctrl.problem.uncertainty import Uncertainty
from ensemble_ctrl.problem.zones import Zone

if TYPE_CHECKING:
    from ensemble_ctrl.planning.online.settings import OnlineSettings

Floats = NDArray[np.float64]
Guarantee = Literal["moment", "nodes", "hull"]
Method = Literal["nlp", "minlp"]
Grid = Literal["coarse", "full"]
Offered = Literal["near", "all", "linear"]
Routes = int | Literal["all"]
Coordinates = Literal["nodal", "modal"]
Integrator = Literal["exponential", "rk4"]


@dataclass(frozen=True, eq=False)
class Objective(ReadOnlyArrays):
    r"""What the plan trades off, ``eq:WayPointObsAvoid`` with weights; smaller cost is better.

    .. math:: -w_\rho\,\rho + w_T \|\tilde m(T) - \tilde m_F\|^2 + w_u \int v^2 + \omega^2\, dt

    Parameters
    ----------
    robustness : float
        Weight of the task's robustness, per metre.
    target : array_like of shape (d,), Formation, MomentTarget or SpreadTarget, optional
        Where the fleet should end: at one place (metres), each member at its own, or with given moments, or mean and
        covariance (`ensemble_ctrl.problem.target`); without it there is no terminal term.
    terminal : float
        Weight of the terminal error, per square metre.
    effort : float or array_like of shape (n_u,)
        Weight of the control effort, the same for all commands or one for each: the energy is the integral of their
        squares.
    smoothness : float
        Weight of the squared rates of the commands, the integral of ``|du/dt|^2``; counted with the effort.
    cvar : Risk, optional
        A penalty on the worst part of the fleet (`ensemble_ctrl.problem.risk`).
    earliest : str, optional
        A region that every member is to pass as soon as possible, before all else; the task goes on to hold
        (`ensemble_ctrl.planning.minimum_time`).
    tolerance : Uncertainty, optional
        Errors of the model of which a plan is to tolerate as large a multiple as can be, before all else
        (`ensemble_ctrl.planning.tolerance`); the fleet has none of its own.
    """

    robustness: float = 1.0
    target: Floats | Target | None = None
    terminal: float = 10.0
    effort: float | Floats = 0.1
    smoothness: float = 0.0
    cvar: Risk | None = None
    earliest: str | None = None
    tolerance: Uncertainty | None = None

    def __post_init__(self) -> None:
        for name in ("robustness", "terminal", "smoothness"):
            value = quantity_of(f"objective.{name}", getattr(self, name), "number")
            object.__setattr__(self, name, value)
        if self.cvar is not None:
            expect("objective.cvar", self.cvar, Risk)
        if self.tolerance is not None:
            expect("objective.tolerance", self.tolerance, Uncertainty)
        if self.earliest is not None:
            expect("objective.earliest", self.earliest, str, "the name of a region")
        if self.target is not None and not isinstance(self.target, Formation | MomentTarget | SpreadTarget):
            place = numbers("objective.target", self.target, "a place [x, y], or a target")
            dimensions = min(max(place.size, 1), 3) if place.ndim == 1 else 2
            object.__setattr__(self, "target", frozen(self.target, (dimensions,), "objective.terminal.target"))
        if not isinstance(self.effort, int | float) or isinstance(self.effort, bool):
            numbers("objective.effort", self.effort, "a weight, or one for each command")
            object.__setattr__(self, "effort", frozen(self.effort, (np.size(self.effort),), "objective.effort"))
        weights = [self.robustness, self.terminal, *np.atleast_1d(self.effort).tolist(), self.smoothness]
        if not np.isfinite(weights).all() or min(weights) < 0:
            raise ProblemError(f"objective: expected finite weights >= 0, got {weights}")

    def efforts(self, n_u: int = 2) -> Floats:
        """The weight of each command, shape (n_u,)."""
        return np.broadcast_to(np.asarray(self.effort, dtype=float), (n_u,))

    @property
    def place(self) -> Floats | None:
        """Where the middle of the fleet should end, shape (d,), metres."""
        if isinstance(self.target, Formation | MomentTarget | SpreadTarget):
            return self.target.middle
        return self.target

    def places(self, fleet: Fleet, members: Floats) -> Floats:
        """Where each member should end, shape (members, d), metres: for targets without places, at `place`."""
        if isinstance(self.target, Formation):
            return self.target.at(members[:, fleet.names.index(self.target.parameter)])
        place = np.asarray(self.place)
        return np.broadcast_to(place, (len(members), len(place)))


@dataclass(frozen=True)
class SolveOptions:
    """How to solve.

    Parameters
    ----------
    method : {"nlp", "minlp"}
        ``nlp``: nonlinear programs with IPOPT.  ``minlp``: the same first; then the facets of the obstacles are chosen
        anew with binaries and Bonmin, and the best certified plan is kept.
    guarantee : {"moment", "nodes", "hull"}
        For whom the program's constraints hold. ``moment``: the paper's rows on moments, necessary only, in effect the
        mean robot. ``nodes``: the robots at the Gauss nodes, at the grid times. ``hull``: every member of the truncated
        model, through whole step intervals.
    time_limit : float
        Seconds after which the best plan so far is returned.
    seed : int
        Seed of every random draw (replayed members).
    margin : float
        Metres that the program keeps to spare: from obstacles beyond the robot's radius, and in the task's robustness.
    routes : int or "all"
        How many geometric routes are tried before the best is refined; ``all`` tries every way of passing the obstacles
        without loops (`ensemble_ctrl.ocp.guesses.roadmap.ALL` at most) and refines the best few.
    max_iterations : int
        Iterations of one solve.
    cells : int
        Equal parts of the (first) parameter's range that have separating hyperplanes of their own: more rows, and less
        is required of a wide fleet, whose members may be on different sides of an obstacle at one time.
    solver : str
        Which solver each nonlinear program is given to, by its name in the registry: ``ipopt``, ``sqp``, or one of
        your own.
    grid : {"coarse", "full"}
        With ``method: minlp``, the grid on which facets are chosen: one of about 32 steps, or the problem's own.
    facets : {"near", "all", "linear"}
        With ``method: minlp``, which facets may be chosen: those near the plan's own, all, or those of a linear model
        of the problem, solved by HiGHS (`ensemble_ctrl.ocp.linear_facets`).
    polish : bool
        With ``method: minlp``, whether a choice of facets is improved with separating hyperplanes and certified with
        more margin; if not, the plan is the solution as it is returned.
    bonmin_limit : float
        Seconds that one run of Bonmin may take.
    """

    method: Method = "nlp"
    guarantee: Guarantee = "hull"
    time_limit: float = 600.0
    seed: int = 0
    margin: float = 0.01
    routes: Routes = 2
    max_iterations: int = 300
    cells: int = 1
    solver: str = "ipopt"
    grid: Grid = "coarse"
    facets: Offered = "near"
    polish: bool = True
    bonmin_limit: float = 7.0

    def __post_init__(self) -> None:
        for name, kind in (("time_limit", "time"), ("margin", "length"), ("bonmin_limit", "time")):
            object.__setattr__(self, name, quantity_of(f"solve.{name}", getattr(self, name), kind))
        object.__setattr__(self, "polish", flag("solve.polish", self.polish))

    @property
    def as_published(self) -> bool:
        """Whether facets are chosen as the paper does it: on moments, on the whole grid, from all, without polish."""
        whole = self.method == "minlp" and self.guarantee == "moment" and self.grid == "full"
        return whole and self.facets != "near" and not self.polish


@dataclass(frozen=True)
class VerifyOptions:
    """How a plan is checked.

    Parameters
    ----------
    members : int
        Robots that are replayed.
    substeps : int
        Samples per step of each.
    certificate : bool
        Whether to prove the plan for every parameter and instant, and to tighten it until that succeeds.
    """

    members: int = 10_000
    substeps: int = 1
    certificate: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "certificate", flag("verify.certificate", self.certificate))


@renamed_fields(twin="baseline")
@dataclass(frozen=True)
class ReportOptions:
    """What figures and summary show.

    Parameters
    ----------
    baseline : bool
        Whether to plan the problem without constraints too, and draw it dashed (`ensemble_ctrl.planning.baseline`).
    suggest : bool
        Whether a run that finds no plan searches for a change of the problem that would help
        (`ensemble_ctrl.planning.suggest`).
    """

    baseline: bool = False
    suggest: bool = True

    def __post_init__(self) -> None:
        for name in ("baseline", "suggest"):
            object.__setattr__(self, name, flag(f"report.{name}", getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Problem:
    """One planning problem.

    Parameters
    ----------
    name : str
        Names the results folder.
    fleet : Fleet
        Who moves.
    duration : float or str
        Horizon in seconds, or as a text with a unit: ``"20 s"``.
    steps : int
        Number of control steps; each lasts ``duration / steps``.
    task : Formula or str
        What every member has to do.
    regions : mapping of str to Polyhedron
        Named areas that the task refers to; a box may be written as ``[[x low, x high], [y low, y high]]``.
    obstacles : mapping of str to tuple of Obstacle
        Named obstacles, each a union of convex pieces. A single piece needs no list, and may be an Obstacle, a bounded
        Polyhedron or a box. Obstacles without names are called o1, o2, ...
    motions : mapping of str to Motion
        How some of the obstacles move from where they are drawn.
    zones : mapping of str to Zone
        Areas to keep out of or to drive slowly in, at all times, whatever the task says.
    terrain : mapping of str to Patch
        Named areas in which parameters of the robots may differ from their own values, such as mud.
    objective : Objective
        What to trade off.
    order : int or None
        Truncation order N (moments 0..N); None chooses it from the accuracy needed.
    solve : SolveOptions
        How to solve.
    verify : VerifyOptions
        How to check.
    report : ReportOptions
        What to show.
    least_duration : float or None
        If given, the plan is as short as possible, from this to `duration` seconds, before all else
        (`ensemble_ctrl.planning.minimum_time`); windows without an end, and ``T``, then follow the plan's own duration.
    online : OnlineSettings or None
        How a loop runs that plans again and again (`ensemble_ctrl.planning.online`), from its file; not for plans.
    ignore : collection of str
        Obstacles that need not be avoided throughout: nothing is changed but that there is no warning of it.
    coordinates : {"nodal", "modal"}
        What stands for the truncated moments in the program: the robots at the Gauss nodes, on exact arcs, or the
        moments themselves with their bilinear dynamics, as in the paper.
    integrator : {"exponential", "rk4"}
        Of modal coordinates: the exact step, or one step of the classical Runge-Kutta rule.
    pairs : tuple of Pair
        Members that keep apart in a program of several starts; made by the planner, and never proven.

    Raises
    ------
    ProblemError
        With every finding of `ensemble_ctrl.problem.checks.findings` that is an error.
    """

    name: str
    fleet: Fleet
    duration: float
    steps: int
    task: Formula
    regions: Mapping[str, Polyhedron] = field(default_factory=dict)
    obstacles: Mapping[str, tuple[Obstacle, ...]] = field(default_factory=dict)
    motions: Mapping[str, Motion] = field(default_factory=dict)
    objective: Objective = field(default_factory=Objective)
    order: int | None = None
    solve: SolveOptions = field(default_factory=SolveOptions)
    verify: VerifyOptions = field(default_factory=VerifyOptions)
    report: ReportOptions = field(default_factory=ReportOptions)
    least_duration: float | None = None
    online: OnlineSettings | None = None
    ignore: Collection[str] = ()
    coordinates: Coordinates = "nodal"
    integrator: Integrator = "exponential"
    zones: Mapping[str, Zone] = field(default_factory=dict)
    terrain: Mapping[str, Patch] = field(default_factory=dict)
    pairs: tuple[Pair, ...] = ()

    def __post_init__(self) -> None:
        from ensemble_ctrl.problem.checks import require_sound

        least = self.least_duration
        read: dict[str, Any] = {
            "name": expect("name", self.name, str, "text"),
            "fleet": expect("fleet", self.fleet, Fleet),
            "duration": quantity_of("duration", self.duration, "time"),
            "task": task_of("task", self.task),
            "regions": ReadOnlyMapping(regions_of("regions", self.regions)),
            "obstacles": ReadOnlyMapping(obstacles_of("obstacles", self.obstacles)),
            "motions": ReadOnlyMapping(mapping_of("motions", self.motions, Motion, "a Motion")),
            "zones": ReadOnlyMapping(mapping_of("zones", self.zones, Zone, "a Zone")),
            "terrain": ReadOnlyMapping(mapping_of("terrain", self.terrain, Patch, "a Patch")),
            "objective": expect("objective", self.objective, Objective),
            "solve": expect("solve", self.solve, SolveOptions),
            "verify": expect("verify", self.verify, VerifyOptions),
            "report": expect("report", self.report, ReportOptions),
            "least_duration": None if least is None else quantity_of("least_duration", least, "time"),
            "ignore": names_of("ignore", self.ignore),
        }
        for name, value in read.items():
            object.__setattr__(self, name, value)
        require_sound(self)

    @property
    def step(self) -> float:
        """Length of a control step in seconds."""
        return self.duration / self.steps

    @property
    def times(self) -> Floats:
        """Grid times in seconds, shape (steps + 1,)."""
        return np.linspace(0.0, self.duration, self.steps + 1)

    @property
    def specification(self) -> Specification:
        """The compiled task: made once, and again only for a copy to which another map or task was given."""
        compiled = self.__dict__.get("_specification")
        if not isinstance(compiled, Specification) or not compiled.is_of(self):
            compiled = Specification.of(self)
            object.__setattr__(self, "_specification", compiled)
        return compiled

    @property
    def uncertain(self) -> bool:
        """Whether robots may leave their model: by the fleet's uncertainty, or in a patch of terrain."""
        return bool(self.fleet.uncertainty or self.terrain)

    @property
    def errors(self) -> dict[str, Any]:
        """Bounds of everything that may move robots beside their model, as plain data."""
        return self.fleet.uncertainty.data() | terrain_data(self.terrain)

    @property
    def pieces(self) -> tuple[tuple[str, Obstacle], ...]:
        """Every convex piece of every obstacle with the obstacle's name."""
        return tuple((name, piece) for name, pieces in self.obstacles.items() for piece in pieces)

    def with_(self, **changes: Any) -> Self:
        """A copy with some fields replaced, checked like a new problem."""
        return replace(self, **known_only("problem.with_", self, changes))

    def __repr__(self) -> str:
        order = "auto" if self.order is None else self.order
        count = len(self.obstacles)
        ranges = self.fleet.parameters.items()
        distributions = ", ".join(f"{name} {one.lower:g}..{one.upper:g}" for name, one in ranges)
        return (
            f"Problem({self.name!r}: {self.fleet.system.name}, {distributions}, "
            f"{self.duration:g} s in {self.steps} steps, order {order}, {count} obstacle{'s' * (count != 1)}, "
            f"task {self.task})"
        )

    def _repr_html_(self) -> str:
        from ensemble_ctrl.problem.drawing import card_html, map_svg

        order = "auto" if self.order is None else str(self.order)
        distributions = self.fleet.parameters.items()
        ranges = ", ".join(f"{name} {one.lower:g} to {one.upper:g}" for name, one in distributions)
        rows = [
            ("fleet", f"{self.fleet.system.name}, {ranges or 'all members equal'}, {self.fleet.size_text}"),
            ("horizon", f"{self.duration:g} s in {self.steps} steps, order {order}"),
            ("task", str(self.task)),
            ("obstacles", str(len(self.obstacles))),
        ]
        return card_html(map_svg(self), self.name, rows)
