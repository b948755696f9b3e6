"""Obstacles that come, move within their uncertainty and go: what a loop proves of them is so, by shapely."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely import Point, Polygon

from ensemble_ctrl.constraints import Disc, Obstacle, Polyhedron
from ensemble_ctrl.constraints.motion import SLICES, Motion
from ensemble_ctrl.constraints.stl import parse
from ensemble_ctrl.core.errors import ProblemError
from ensemble_ctrl.moments import Interval
from ensemble_ctrl.planning.online.driver import Outcome, drive
from ensemble_ctrl.planning.online.findings import loop_findings
from ensemble_ctrl.planning.online.loop import Receding
from ensemble_ctrl.planning.online.measurement import Measurement
from ensemble_ctrl.planning.online.settings import OnlineSettings
from ensemble_ctrl.planning.online.simulated import FINE, SimulatedRobot
from ensemble_ctrl.planning.online.simulated_obstacles import ObstacleSettings, SimulatedScene, Straying
from ensemble_ctrl.problem import Problem

from .problems import FLEET, NOISE, SHORT, options, plan, robot

Floats = NDArray[np.float64]
START = Measurement(0.0, 0.0, 0.0, 0.0)
BOX = Obstacle.box([[1.2, 1.5], [-1.2, -0.9]])


@dataclass
class Watched:
    """A run in which what was claimed in each control step is noted beside what is on the map then."""

    loop: Receding
    driven: SimulatedRobot
    scene: SimulatedScene
    claims: list[tuple[float, dict[str, Motion | None]]] = field(default_factory=list)

    def run(self) -> Outcome:
        """Drive to the end."""
        send, lead = self.driven.send, self.loop.options.lead(self.loop.problem.step) * self.loop.problem.step

        def sending(begin: float, controls: Floats) -> None:
            send(begin, controls)
            claimed = self.loop.history[-1].proof != "none" and not self.loop.alarmed
            if claimed and self.driven.now() >= lead:
                names = [name for name in self.scene.obstacles if name in self.loop.problem.obstacles]
                moving = {name: self.loop.problem.motions.get(name) for name in names}
                self.claims.append((self.driven.now() - lead, moving))

        self.driven.send = sending  # type: ignore[method-assign]
        changing = lambda now: self.scene.advance(self.loop, now, self.driven.pose[None, :2])  # noqa: E731
        self.outcome = drive(self.loop, self.driven, self.driven, scene=changing)
        self.start = self.outcome.start
        return self.outcome

    def places(self, begin: float) -> list[tuple[float, Point]]:
        """Where the robot truly was in the control step from `begin` on."""
        step = self.loop.problem.step
        first = round((begin + self.start) / step) * FINE
        track = self.driven.track[first : first + FINE + 1]
        return [(begin + k * step / FINE, Point(*pose[:2])) for k, pose in enumerate(track)]

    def gap(self, *, worst: bool) -> float:
        """Smallest gap between the robot and an obstacle at a time of a claim, metres.

        Of where the obstacle truly was, or, with `worst`, of the worst place that its prediction allowed.
        """
        least, radius = np.inf, self.loop.problem.fleet.radius
        for begin, moving in self.claims:
            for name, motion in moving.items():
                obstacle = self.scene.obstacles[name]
                for time, place in self.places(begin):
                    if not worst:
                        motion = obstacle.truth
                    offset = np.zeros(2) if motion is None else motion.at(time)
                    loose = 0.0 if motion is None else motion.uncertainty + motion.growth * (time - motion.since)
                    shapes = [Polygon(piece.vertices + offset) for piece in obstacle.settings.pieces]
                    least = min(least, *(place.distance(shape) - radius - loose for shape in shapes))
        return least


def watched(obstacles: dict[str, ObstacleSettings], problem: Problem = SHORT, **changes: Any) -> Watched:
    """A loop on a problem with what comes on the way."""
    controls = plan() if problem is SHORT else None
    loop = Receding(problem, options(**changes), controls, process_time)
    return Watched(loop, robot(1.03, 2), SimulatedScene(obstacles))


def coming(
    box: Obstacle,
    velocity: Sequence[float],
    strays: Straying = "towards",
    loose: tuple[float, float] = (0.02, 0.03),
    **when: Any,
) -> ObstacleSettings:
    """Something that comes with a velocity."""
    motion = Motion.steady(velocity, 30.0, 0.0, *loose)
    return ObstacleSettings((box,), **{"appears": 0.5, "motion": motion, "strays": strays, **when})


# --- what is claimed is so


@pytest.mark.parametrize("strays", ["towards", "random", "away"])
@pytest.mark.parametrize("again", [None, 0.7])
def test_what_moves_adversarially_is_never_met_while_something_is_proven(strays: Straying, again: float | None) -> None:
    run = watched({"cart": coming(BOX, [0.0, 0.2], strays, seen_every=again)})
    outcome = run.run()
    assert len(run.claims) > 10
    assert run.gap(worst=True) >= -1e-9
    assert run.gap(worst=False) >= run.gap(worst=True) - 1e-9
    assert outcome.ending == "success" if run.loop.proven else outcome.ending != "success"


def test_carts_from_anywhere() -> None:
    rng, most, proven = np.random.default_rng(4), 8, 0
    for seed in range(most):
        x, y = rng.uniform(0.6, 2.4), rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.2)
        box = Obstacle.box([[x, x + 0.25], [y - 0.125, y + 0.125]])
        velocity = [rng.uniform(-0.3, 0.3), -np.sign(y) * rng.uniform(0.1, 0.5)]
        run = watched({"cart": coming(box, velocity, loose=(0.03, 0.05), appears=rng.uniform(0, 3), seed=seed)})
        outcome = run.run()
        assert run.gap(worst=True) >= -1e-9, seed
        if outcome.ending == "success":
            proven += 1
            truth = run.scene.obstacles["cart"].truth
            times = np.linspace(truth.times[0], truth.times[-1], 300)
            track, grid = np.array(run.driven.track), run.start + times
            fine = np.arange(len(track)) * SHORT.step / FINE
            places = np.stack([np.interp(grid, fine, track[:, axis]) for axis in (0, 1)], axis=1)
            shapes = [Polygon(box.vertices + offset) for offset in truth.at(times)]
            gaps = [Point(*place).distance(shape) for place, shape in zip(places, shapes, strict=True)]
            assert min(gaps) >= FLEET.radius
    assert proven >= 2


def test_a_way_that_is_free_but_for_the_uncertainty_is_left() -> None:
    """The same cart is passed closely where it is known well, and not where it is not."""
    box = Obstacle.box([[1.2, 1.5], [-1.65, -1.35]])
    gaps = []
    for loose in ((0.0, 0.0), (0.1, 0.03)):
        run = watched({"cart": coming(box, [0.0, -0.02], loose=loose, strays="none", appears=0.2)})
        run.run()
        assert run.gap(worst=True) >= -1e-9
        gaps.append(run.gap(worst=False))
    assert gaps[1] >= 0.1
    assert gaps[1] > gaps[0]


def test_a_cart_that_comes_through_where_the_robots_stand_is_no_success() -> None:
    """Nothing is proven while it passes, since standing is no help."""
    wide = Obstacle.box([[3.2, 3.4], [-6.0, 6.0]])
    settings = coming(wide, [-1.2, 0.0], strays="none", appears=0.6, vanishes=4.9)
    task = parse("F[8,9] in(goal) and G avoid(obstacles)")
    run = watched({"wall": settings}, SHORT.with_(duration=9.0, steps=90, task=task))
    outcome = run.run()
    assert not run.loop.proven
    assert outcome.ending != "success"
    assert run.gap(worst=True) >= -1e-9


def test_an_obstacle_that_goes_gives_the_way_free() -> None:
    wall = Obstacle.box([[1.6, 1.8], [-3.0, 3.0]])
    settings = ObstacleSettings((wall,), appears=0.5, vanishes=1.5)
    run = watched({"wall": settings}, recovery=0.5, attempts=9)
    outcome = run.run()
    assert "wall" not in run.loop.problem.obstacles
    assert run.loop.problem.regions["goal"].margin(run.driven.pose[:2]) > 0
    assert outcome.ending == "success"


@pytest.mark.parametrize(("ahead", "goes"), [(0.1, 2.5), (0.1, None), (0.9, 2.5)])
def test_driving_on_through_what_has_come_is_no_success(ahead: float, goes: float | None) -> None:
    """Nothing is proven of commands on the way, unless robots stand before it, which is too thin to be noticed."""
    far = {"far": (Obstacle.box([[-3.0, -2.5], [3.0, 3.5]]),)}
    task = parse("F[6,8] in(goal) and G avoid(obstacles)")
    problem = SHORT.with_(obstacles=far, fleet=FLEET.with_(radius=0.0), duration=8.0, steps=80, task=task)
    straight = np.repeat([[0.6, 0.0], [0.0, 0.0]], 40, axis=0)
    loop = Receding(problem, options(applied_steps=5, deadline=0.5, recovery=0.5), straight, lambda: 0.0)
    driven = robot(1.0, 2)
    strips: list[tuple[float, float]] = []

    def scene(now: float) -> None:
        x, y = driven.pose[:2]
        if now >= 1.0 and not strips:
            strips.append((x + ahead, x + ahead + 0.02))
            loop.add_obstacle("strip", [Obstacle.box([strips[0], (y - 9.0, y + 9.0)])])
        if goes is not None and now >= goes and "strip" in loop.problem.obstacles:
            assert "none" in [step.proof for step in loop.history]
            loop.remove_obstacle("strip")

    outcome = drive(loop, driven, driven, scene=scene)
    assert loop.problem.regions["goal"].margin(driven.pose[:2]) > 0
    assert outcome.ending == ("finished" if ahead < 0.5 else "success")
    if goes is None:
        track = np.array(driven.track)[:, 0]
        assert ((track > strips[0][0]) & (track < strips[0][1])).any()


@pytest.mark.parametrize(("window", "proven"), [("", True), ("[3,4]", False)])
def test_standing_is_no_help_against_what_counts_only_later(window: str, proven: bool) -> None:
    """A robot may be stopped where it must not be later; a proof from a later time on does not know of that."""
    far = {"far": (Obstacle.box([[-3.0, -2.5], [3.0, 3.5]]),)}
    task = parse(f"F[4,5] in(goal) and G{window} avoid(obstacles)")
    straight = np.repeat([[0.6, 0.0], [0.0, 0.0]], [40, 10], axis=0)
    loop = Receding(SHORT.with_(task=task, obstacles=far), options(), straight, lambda: 0.0)
    loop.step(START)
    loop.late(12)
    pose = loop.trackers["robot"].pose(1.2)
    assert pose is not None
    loop.step(Measurement(1.2, float(pose.position[0]), float(pose.position[1]), pose.heading))
    assert loop.history[-1].proof == "whole"
    assert loop.proven is proven


def test_what_goes_may_have_been_wanted() -> None:
    """A task to be in some obstacle is not done any more when that has gone."""
    task = parse("F[4,5] in(goal) and F[0,5] not avoid(obstacles)")
    gate = {"gate": (Obstacle.box([[1.2, 1.9], [-1.0, 1.0]]),), "far": (Obstacle.box([[-3.0, -2.5], [3.0, 3.5]]),)}
    fleet = FLEET.with_(parameters={"traction": Interval(0.99, 1.01)})
    straight = np.repeat([[0.6, 0.0], [0.0, 0.0]], [40, 10], axis=0)
    loop = Receding(SHORT.with_(task=task, obstacles=gate, fleet=fleet), options(), straight, lambda: 0.0)
    loop.step(START)
    assert loop.proven
    loop.remove_obstacle("gate")
    assert loop.alarmed
    assert not loop.proven


def test_what_was_entered_before_it_went_is_not_forgotten() -> None:
    loop = Receding(SHORT, options(), plan(), process_time)
    loop.step(START)
    loop.observe(Measurement(0.5, 0.15, 0.0, 0.0))
    loop.elapsed = 0.5
    pose = loop.trackers["robot"].pose(0.5)
    assert pose is not None
    x, y = pose.position
    loop.add_obstacle("rock", [Obstacle.box([[x - 1, x + 1], [y - 1, y + 1]])])
    assert loop.stopped == "the robot may be in rock"
    later = loop.trackers["robot"].pose(1.0)
    assert later is not None
    loop.observe(Measurement(1.0, float(later.position[0]), float(later.position[1]), later.heading))
    loop.remove_obstacle("rock")
    assert loop.entered() == "the robot was in rock"


def test_one_that_may_be_elsewhere_was_not_surely_entered() -> None:
    loop = Receding(SHORT, options(), plan(), process_time)
    loop.step(START)
    here = Obstacle.box([[-0.2, 0.2], [-0.2, 0.2]])
    loop.add_obstacle("ghost", [here], Motion.steady([0.0, 0.0], 5.0, uncertainty=1.0))
    assert loop.stopped == "the robot may be in ghost"
    assert loop.entered() == ""
    loop.update_obstacle("ghost", Motion.steady([0.0, 0.0], 5.0))
    assert loop.entered() == "the robot was in ghost"


def test_a_receding_horizon_keeps_out_of_what_moves_at_any_time() -> None:
    problem = SHORT.with_(
        task=parse("G in(goal) and G avoid(obstacles)"),
        regions={"goal": Polyhedron.box([[-1.0, 3.5], [-1.5, 1.5]])},
        duration=2.0,
        steps=20,
    )
    box = Obstacle.box([[2.3, 2.5], [1.2, 1.4]])
    cart = coming(box, [0.0, -0.25], loose=(0.02, 0.01), appears=2.5, seen_every=0.5)
    run = watched({"cart": cart}, problem, horizon="receding", run_for=6.5, deadline=0.5)
    run.run()
    late = [claim for claim in run.claims if claim[0] > 3.0 and claim[1]]
    assert len(late) > 20
    assert run.gap(worst=True) >= -1e-9


# --- how it is said


def test_slices_cover_a_window_with_what_may_be_by_their_ends() -> None:
    motion = Motion.steady([0.1, 0.0], 20.0, begin=3.0, uncertainty=0.05, growth=0.02)
    found = list(motion.slices(0.0, 20.0))
    assert (found[0][0], found[-1][1]) == (0.0, 20.0)
    assert len(found) <= SLICES
    assert all(this[1] == following[0] for this, following in pairwise(found))
    for begin, end, more in found:
        for time in np.linspace(begin, end, 7):
            assert more >= 0.05 + 0.02 * max(time - 3.0, 0.0)
    assert list(Motion.steady([0.1, 0.0], 20.0).slices(1.0, 2.0)) == [(1.0, 2.0, 0.0)]


@given(
    shift=st.floats(-1e3, 1e3),
    time=st.floats(0, 50),
    growth=st.floats(0, 2),
    since=st.floats(0, 20),
)
def test_a_later_clock_takes_nothing_from_the_uncertainty(
    shift: float, time: float, growth: float, since: float
) -> None:
    motion = Motion(np.array([0.0, 50.0]), np.eye(2), 0.1, growth, since)
    assert motion.later(shift).loose(time - shift) >= 0.1 + growth * max(time - since, 0.0)


def refused(change: Callable[[Receding], None], problem: Problem = SHORT) -> str:
    """What a loop says to a change of its map that it can't take."""
    loop = Receding(problem, options(), plan(), process_time)
    with pytest.raises(ProblemError) as error:
        change(loop)
    assert loop.problem.obstacles.keys() == problem.obstacles.keys()
    return str(error.value)


def test_changes_that_make_no_sense_are_refused() -> None:
    still = Motion.steady([0.0, 0.0], 5.0)
    assert refused(lambda loop: loop.remove_obstacle("cart")) == (
        "obstacle: expected one that is on the map (block), got 'cart'"
    )
    assert "expected one that is on the map (block)" in refused(lambda loop: loop.update_obstacle("cart", still))
    named = SHORT.with_(task=parse("F[4,5] in(goal) and G avoid(block)"))
    message = refused(lambda loop: loop.remove_obstacle("block"), named)
    assert message == "obstacle: expected one that the task does not name, got 'block'"
    sometimes = SHORT.with_(task=parse("F[4,5] (in(goal) and avoid(obstacles))"))
    message = refused(lambda loop: loop.add_obstacle("cart", [BOX], still), sometimes)
    assert message == "obstacle: 'cart' moves, and a moving obstacle can only be avoided throughout a window"


SOLID = Polyhedron.box([[3.0, 3.5], [3.0, 3.5], [0.0, 1.0]])
IN_SPACE = Motion(np.array([0.0, 1.0]), np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        # the task's word for all of them would be for this one alone
        (("obstacles", [BOX]), "expected another name, 'obstacles' is a word of the task language"),
        (("block", [BOX]), "expected a new name, got 'block'"),
        (("", [BOX]), "expected a name, got an empty one"),
        ((["cart"], [BOX]), "expected a name, got ['cart'] (list)"),
        (("cart", []), "expected one or more convex pieces in the plane, got none"),
        (("cart", [SOLID]), "expected one or more convex pieces in the plane, got one in space"),
        (("cart", [BOX], (0.1, 0.0)), "expected a Motion, got (0.1, 0.0) (tuple)"),
        (("cart", [BOX], IN_SPACE), "expected a motion with displacements [x, y], got [x, y, z]"),
    ],
)
def test_what_is_no_obstacle_leaves_the_map_as_it_is(given: tuple[Any, ...], message: str) -> None:
    assert refused(lambda loop: loop.add_obstacle(*given)) == f"obstacle: {message}"


def test_a_motion_in_space_is_refused_before_the_loop_begins() -> None:
    settings = OnlineSettings(options(), obstacles={"cart": ObstacleSettings((BOX,), 0.5, motion=IN_SPACE)})
    (found,) = loop_findings(SHORT.with_(online=settings))
    assert found.path == ("online", "obstacles", "cart", "motion")
    assert found.message == "expected 2 dimensions (x, y), got 3"


@pytest.mark.parametrize("now", [np.nan, np.inf])
def test_a_clock_without_a_time_is_refused(now: float) -> None:
    def late(loop: Receding) -> None:
        loop.elapsed = now
        loop.add_obstacle("cart", [BOX])

    assert refused(late) == f"elapsed: expected finite seconds since the plan began, got {now}"


@pytest.mark.parametrize("name", ["uncertainty", "growth"])
def test_an_uncertainty_below_nothing_is_refused(name: str) -> None:
    with pytest.raises(ProblemError, match=rf"motion\.{name}: expected a finite number >= 0, got -0\.1"):
        Motion(np.array([0.0, 1.0]), np.eye(2), **{name: -0.1})


def test_discs_move_too() -> None:
    disc = Disc([1.4, -1.2], 0.15)
    run = watched({"disc": ObstacleSettings((disc,), 0.5, motion=Motion.steady([0, 0.2], 9.0, 0.0, 0.02, 0.03))})
    run.run()
    assert len(run.claims) > 10
    assert run.gap(worst=True) >= -1e-9
    assert NOISE.position < 0.15
