"""Parts that are added from outside the package, one for each place where it can be extended: each under 40 lines."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

import ensemble_ctrl as ec
from ensemble_ctrl.certificate import PROOFS, Bound, TaskBound, certify
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.files.config import dump, load_text
from ensemble_ctrl.files.folder import result_files
from ensemble_ctrl.moments import DISTRIBUTIONS
from ensemble_ctrl.moments.basis import gauss_rule
from ensemble_ctrl.moments.lanczos import recurrence_of_points
from ensemble_ctrl.moments.orthonormal import WeightedDistribution
from ensemble_ctrl.moments.recurrence import Recurrence, values
from ensemble_ctrl.report.plot import KINDS, PlotKind, write_plot
from ensemble_ctrl.systems import SYSTEMS
from tests.report.plans import made

Floats = NDArray[np.float64]
FILE = """
fleet: {{model: {model}, parameters: {{{parameters}}}, start: {start}}}
horizon: {{duration: 4 s, steps: 16}}
regions: {{goal: {{box: [[1, 3], [-1, 1]]}}}}
task: F[3, 4] in(goal)
verify: {{members: 50}}
"""


class Trolley(ec.OdeSystem):
    """Commands are velocities, with an unknown gain."""

    name, summary, states, positions = "trolley", "an omnidirectional base", ("x", "y"), ("x", "y")
    controls, control_units, input_bounds = ("u", "v"), ("m/s", "m/s"), ((-1.0, 1.0), (-1.0, 1.0))
    parameters: ClassVar[Mapping[str, float]] = {"gain": 1.0}  # type: ignore[misc]
    enclosure = "corners"

    def xdot(self, x: Any, u: Any, psi: Mapping[str, Any]) -> list[Any]:
        return [psi["gain"] * u[0], psi["gain"] * u[1]]


@dataclass(eq=False)
class Corners:
    """Bounds of a trolley: its place is bilinear in gain and time, so within the hull of the corners of both."""

    problem: ec.Problem
    controls: Floats
    distributions: Mapping[str, ec.Distribution]
    boxes: int = 0

    def nearness(self, avoid: Any) -> float:
        """All are looked at alike."""
        return 0.0

    def clearance(self, avoid: Any, enough: float = np.inf) -> Bound:
        """The largest facet distance of each step's corners; avoidance in all the horizon only."""
        (distribution,), fleet = self.distributions.values(), self.problem.fleet
        way = np.concatenate([np.zeros((1, 2)), np.cumsum(self.controls, axis=0)]) * self.problem.step
        ends = fleet.start_place + np.array([distribution.lower, distribution.upper])[:, None, None] * way
        cells = np.concatenate([ends[:, :-1], ends[:, 1:]])
        rows = [piece.unit_rows() for piece in avoid.pieces]
        gap = min(float((cells @ G.T - h).min(axis=0).max(axis=-1).min()) for G, h in rows) - avoid.radius
        seen = float(avoid.distances(ends, self.problem.times).min())
        self.boxes += cells.shape[1]
        return Bound(avoid.name, gap - 1e-9, seen + 1e-9, {"gain": distribution.lower}, 0.0)

    def part(self, part: Any) -> TaskBound:
        """Nothing is proven of other parts."""
        return TaskBound(str(part), -np.inf, np.inf, {}, covered=False)

    def share(self, chance: Any) -> TaskBound:
        """Nor of shares."""
        return self.part(chance.part)


@dataclass(frozen=True)
class Triangular(WeightedDistribution):
    """A triangle over the range, highest at the mode."""

    lower: float
    upper: float
    mode: float
    numbers = ("mode",)

    def _rule(self, edges: Floats) -> tuple[Floats, Floats]:
        """Points and weights on panels, exact for polynomials times the density."""
        nodes, weights = gauss_rule(64)
        half, peak = np.diff(edges)[:, None] / 2, float(self.to_scaled(self.mode))
        s = (edges[:-1, None] + half * (1 + nodes)).ravel()
        return s, (half * weights).ravel() * 2 * np.where(s < peak, (1 + s) / (1 + peak), (1 - s) / (1 - peak))

    def _edges(self, end: float) -> Floats:
        return np.unique(np.clip([-1.0, float(self.to_scaled(self.mode)), 1.0], -1.0, end))

    def recurrence(self, order: int) -> Recurrence:
        return recurrence_of_points(*self._rule(self._edges(1.0)), order)

    def partial_moments(self, recurrence: Recurrence, s: Floats) -> Floats:
        rules = [self._rule(self._edges(float(end))) for end in np.ravel(s)]
        found = [weights @ values(recurrence, points) for points, weights in rules]
        return np.array(found).reshape(*np.shape(s), -1)

    def cdf(self, psi: Any) -> Floats:
        at, width = np.clip(psi, self.lower, self.upper), self.upper - self.lower
        up, down = (at - self.lower) ** 2 / (self.mode - self.lower), (self.upper - at) ** 2 / (self.upper - self.mode)
        return np.asarray(np.where(at < self.mode, up / width, 1 - down / width))

    def _draw(self, count: int, rng: np.random.Generator) -> Floats:
        return np.asarray(rng.triangular(self.lower, self.mode, self.upper, count))


def draw_speed(plan: Any, ax: Any) -> Any:
    """The first command over time."""
    ax.step(plan.problem.times[:-1], plan.controls[:, 0], where="post")
    ax.set(xlabel="t [s]", ylabel="v [m/s]")
    return ax


@pytest.mark.parametrize("part", [Trolley, Corners, Triangular, draw_speed])
def test_each_part_takes_fewer_than_forty_lines(part: Callable[..., Any]) -> None:
    assert len(inspect.getsource(part).splitlines()) < 40


def test_a_system(monkeypatch: pytest.MonkeyPatch) -> None:
    """A problem file names it; it is planned, and written back."""
    monkeypatch.setitem(SYSTEMS, "trolley", Trolley)
    monkeypatch.setattr(Trolley, "enclosure", "general")
    text = FILE.format(model="trolley", parameters="gain: {range: [0.9, 1.1]}", start="{position: [0, 0]}")
    problem = load_text(text)
    plan = ec.plan(problem)
    assert plan.replayed is not None
    assert plan.replayed.satisfied == 1.0
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"
    assert isinstance(load_text(dump(problem)).fleet.system, Trolley)


def test_an_enclosure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its bounds are those of the certificate, and lie between what is true and what another enclosure proves."""
    fleet = ec.Fleet(Trolley(), {"gain": ec.Interval(0.9, 1.1)})
    post = (ec.Obstacle.box([[0.5, 0.8], [0.7, 1.0]]),)
    problem = ec.Problem("p", fleet, 2.0, 8, parse("G avoid(post)"), {}, {"post": post})
    ahead = np.tile([0.5, 0.1], (8, 1))
    monkeypatch.setitem(PROOFS, "corners", Corners)
    mine = certify(problem, ahead)
    monkeypatch.setitem(PROOFS, "corners", PROOFS["general"])
    general = certify(problem, ahead)
    assert (mine.proven, general.proven) == ("yes", "yes")
    assert mine.clearance <= general.clearances[0].sampled
    assert mine.clearance == pytest.approx(general.clearance, abs=0.05)
    assert certify(problem, 2 * np.tile([0.4, 0.45], (8, 1))).proven == "no"


def test_a_distribution(monkeypatch: pytest.MonkeyPatch) -> None:
    """A problem file names it with its numbers; its moments are those of its density."""
    monkeypatch.setitem(DISTRIBUTIONS, "triangular", Triangular)
    distribution = "{range: [0.9, 1.2], distribution: triangular, numbers: {mode: 1.0}}"
    problem = load_text(
        FILE.format(
            model="unicycle", parameters=f"traction: {distribution}", start="{position: [0, 0], heading: 0 deg}"
        )
    )
    traction = problem.fleet.parameters["traction"]
    assert traction == Triangular(0.9, 1.2, 1.0)
    s, weights = traction.rule(6)
    assert weights @ traction.to_parameter(s) / 2 == pytest.approx((0.9 + 1.2 + 1.0) / 3)
    assert np.mean(traction.sample(20_000, 0)) == pytest.approx((0.9 + 1.2 + 1.0) / 3, abs=2e-3)
    assert load_text(dump(problem)).fleet.parameters["traction"] == traction
    plan = ec.plan(problem)
    assert plan.certificate is not None
    assert plan.certificate.proven == "yes"


@pytest.mark.parametrize(
    ("distribution", "message"),
    [
        ("distribution: triangular", "expected mode for triangular, but mode is missing"),
        (
            "distribution: triangular, numbers: {mode: 1.0, width: 2}",
            "expected no width in numbers for triangular",
        ),
        ("distribution: uniform, numbers: {mode: 1.0}", "expected no mode in numbers for uniform"),
        ("distribution: triangle", "'triangle' is not one of uniform, beta, normal, triangular"),
    ],
)
def test_numbers_of_a_distribution_are_checked(
    distribution: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(DISTRIBUTIONS, "triangular", Triangular)
    parameters = f"traction: {{range: [0.9, 1.2], {distribution}}}"
    with pytest.raises(ec.ConfigError, match=message):
        load_text(FILE.format(model="unicycle", parameters=parameters, start="{position: [0, 0], heading: 0 deg}"))


def test_a_kind_of_picture(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`Plan.plot` draws it, a file holds it, and the results folder takes it for a result."""
    monkeypatch.setitem(KINDS, "speed", PlotKind(draw_speed, height=1.8))
    ax = made("plain").plot("speed", ax=Figure().subplots())
    assert ax.get_ylabel() == "v [m/s]"
    assert write_plot(made("plain"), "speed", tmp_path / "speed.png").stat().st_size > 1000
    assert "figure-speed.png" in result_files()
