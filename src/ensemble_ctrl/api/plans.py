"""The plan a user holds: controls with their problem, and verbs to replay, draw, save and load it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ensemble_ctrl.api.blocks import Draw, replay_on
from ensemble_ctrl.certificate import Certificate, certify
from ensemble_ctrl.core.deferred import dataclass
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.core.readonly import ReadOnlyArrays
from ensemble_ctrl.core.renamed import renamed_fields
from ensemble_ctrl.core.values import expect, flag, number, numbers, path_of, whole
from ensemble_ctrl.files import planfile
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.moments import Distribution
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.problem.evaluation.adversary import Attack, attack
from ensemble_ctrl.problem.evaluation.conflicts import Conflict, conflicts
from ensemble_ctrl.problem.evaluation.sampled import Replay, replay
from ensemble_ctrl.problem.evaluation.streaming import SIZE, replay_blocks
from ensemble_ctrl.problem.evaluation.summary import Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

    from ensemble_ctrl.planning.planner import Progress, Status
    from ensemble_ctrl.planning.suggest import Suggestions
    from ensemble_ctrl.planning.tolerance import Tolerance

Floats = NDArray[np.float64]

STATUSES = ("planned", "infeasible", "limit", "interrupted")
"""How a search can end."""


@renamed_fields(twin="baseline")
@dataclass(frozen=True, eq=False)
class Plan(ReadOnlyArrays):
    """A broadcast control for the whole fleet, and what is known of it.

    Attributes
    ----------
    problem : Problem
        The problem that was solved.
    controls : ndarray, shape (steps, n_u)
        Commands of every step, in the units of the system's controls; read-only.
    status : {"planned", "infeasible", "limit", "interrupted"}
        How the search ended. Only `replayed` and `certificate` show whether members are safe.
    details : dict
        What the search did: order, cost and its parts, iterations, routes, seconds.
    replayed : Replay or None
        The last replay that was run on this plan when it was made.
    certificate : Certificate or None
        What is proven of it for every parameter and instant, if a certificate was requested.
    baseline : ndarray of shape (steps, n_u), or None
        Commands of the problem's unconstrained baseline, for figures only; not saved.

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
    baseline: Floats | None = None

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
        """Whether a plan was found, no replayed member violates it, and its certificate, if any, is ``yes``."""
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

    def replay_blocks(
        self,
        members: int,
        *,
        substeps: int | None = None,
        seed: int | None = None,
        block: int = SIZE,
        watch: Callable[[Summary], bool] | None = None,
        cluster: str | None = None,
        checkpoint: str | Path | None = None,
    ) -> Summary:
        """Run the controls on any number of members in bounded memory.

        Members come in blocks of `block`, of which only a summary stays. With `cluster` or `checkpoint` see
        `ensemble_ctrl.api.blocks.replay_on`: the same summary, bit for bit. Else see
        `ensemble_ctrl.problem.evaluation.streaming.replay_blocks`.
        """
        if cluster is None and checkpoint is None:
            return replay_blocks(
                self.problem, self.controls, members, substeps=substeps, seed=seed, size=block, watch=watch
            )
        draw = Draw(members, seed, substeps, block)
        return replay_on(self.problem, self.controls, draw, cluster or "local", checkpoint=checkpoint, watch=watch)

    def certify(self, ranges: Mapping[str, Distribution] | None = None, *, each: bool = False) -> Certificate:
        """Prove the plan for every member, or for one of other ranges; see `ensemble_ctrl.certificate`.

        With `each` the bound of every obstacle is refined, and not of the near ones alone.
        """
        return certify(self.problem, self.controls, ranges, each=each)

    def tolerance(self, attacked: bool = False) -> Tolerance:
        """How much error of the model the plan tolerates, by kind; see `ensemble_ctrl.planning.tolerance.measure`.

        With `attacked` also with which bounds a disturbance is found that breaks it.
        """
        from ensemble_ctrl.planning.tolerance import measure

        return measure(self.problem, self.controls, attacked=flag("attacked", attacked))

    def attack(self, seed: int | None = None) -> Attack:
        """The closest that a disturbance within the fleet's bounds brings a robot to what it avoids, as far as found.

        See `ensemble_ctrl.problem.evaluation.adversary`.
        """
        return attack(self.problem, self.controls, self.problem.solve.seed if seed is None else seed)

    def conflicts(self) -> tuple[Conflict, ...]:
        """What fails, by how much, when and for whom; empty for a good plan."""
        return self._conflicts

    @cached_property
    def _conflicts(self) -> tuple[Conflict, ...]:
        """Found once: a failing plan's summary, page and files all need them."""
        return conflicts(self.problem, self.controls)

    def suggest(self, seconds: float = 30.0, *, progress: Progress | None = None) -> Suggestions:
        """Where no plan was found: a change of the problem with one; see `ensemble_ctrl.planning.suggest`."""
        from ensemble_ctrl.planning.suggest import suggest

        return suggest(self.problem, self.controls, seconds=number("seconds", seconds), progress=progress)

    def plot(self, kind: str = "trajectories", ax: Axes | None = None) -> Axes:
        """Draw one kind of picture; returns the axes and shows nothing.

        Parameters
        ----------
        kind : {"trajectories", "controls", "moments", "robustness", "clearance", "spread", "certificate"}
            What to draw. For a certificate the plan is certified, each obstacle of its own, if it is not yet.
        ax : matplotlib Axes, optional
            Where to; without it a new figure of pyplot's.

        Raises
        ------
        ProblemError
            For another kind.
        """
        from ensemble_ctrl.report.plot import draw

        known = self.certificate is not None and self.certificate.enough is None
        needs = expect("kind", kind, str, "a kind of picture") == "certificate" and not known
        return draw(replace(self, certificate=self.certify(each=True)) if needs else self, kind, ax)

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
            For another ending, a length that is none, and for a video without ffmpeg.
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
        *Guarantee*: what is proven of a plan is proven of robots that receive its commands. It does not hold for robots
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
        from ensemble_ctrl.report.svg import plan_card

        return plan_card(self)


def checked(plan: Plan, run: Replay | None, certificate: Certificate | None) -> Plan:
    """The plan with another replay and certificate."""
    return replace(plan, replayed=run, certificate=certificate)
