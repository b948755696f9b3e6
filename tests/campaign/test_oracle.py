"""The oracle against simpler ways to the same numbers: it has to be right before it may judge."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from shapely import Point, Polygon

from tests.examples import quick

from . import monitor
from .arcs import Motion
from .cases import FAMILIES, make, of_family
from .distributions import drawn, points, quantiles
from .judge import judge
from .model import Case, Distribution, Long, Longs, ends_of, text
from .monitor import Signal
from .oracle import Duty, Oracle
from .shapes import corners_of, signed_distance

DISTRIBUTIONS: tuple[Distribution, ...] = (
    ("uniform", 0.8, 1.2),
    ("beta", 0.8, 1.2, 2.0, 5.0),
    ("normal", 0.8, 1.2, 1.15, 0.1),
    ("samples", (0.9, 1.0, 1.2, 1.2)),
    ("mixture", ((("uniform", 0.8, 0.9), 2.0), (("beta", 1.0, 1.2, 2.0, 2.0), 1.0))),
)


def case_of(**changes: object) -> Case:
    """A unicycle that drives along +x at 1 m/s for 10 s."""
    given: dict[str, object] = {
        "family": "",
        "system": "unicycle",
        "heading_from": "x",
        "wheelbase": 0.3,
        "parameters": {"traction": ("uniform", 1.0, 1.0)},
        "position": (0.0, 0.0),
        "heading": 0.0,
        "radius": 0.0,
        "duration": 10.0,
        "controls": ((1.0, 0.0),) * 10,
        "task": ("pred", 1.0, 0.0, 0.0),
    }
    return Case(**{**given, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(20))
def test_places_are_those_of_the_differential_equation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = of_family(["plain", "turning", "cars", "starts", "ranged"][seed % 5], rng)
    motion = Motion(case)
    member = np.array([[rng.uniform(*ends_of(distribution)) for distribution in case.distributions.values()]]).reshape(
        1, -1
    )
    time = float(rng.uniform(0, case.duration))
    a, b, heading, place = motion.drives(member)
    with mpmath.workdps(30):
        at, angle = mpmath.mpc(*map(str, place[0])), mpmath.mpf(str(heading[0]))
        left, step = mpmath.mpf(time), mpmath.mpf(case.duration) / len(case.controls)
        for first, second in case.controls:
            span = min(left, step)
            turn = mpmath.mpf(second)
            if case.system == "bicycle":
                turn = mpmath.mpf(first) * mpmath.tan(turn) / mpmath.mpf(case.wheelbase)
            turn *= mpmath.mpf(str(b[0])) * (-1 if case.heading_from == "y" else 1)
            speed = mpmath.mpf(str(a[0])) * mpmath.mpf(first)
            at += mpmath.quad(
                lambda s, a=angle, w=turn, v=speed: v * mpmath.expj(a + w * s), mpmath.linspace(0, span, 9)
            )
            angle, left = angle + turn * span, left - span
    found = motion.paths(member, np.array([time], dtype=Long))[0, 0]
    assert abs(float(found[0]) - float(at.real)) < 1e-14 * (1 + abs(float(at.real)))
    assert abs(float(found[1]) - float(at.imag)) < 1e-14 * (1 + abs(float(at.imag)))


@pytest.mark.parametrize("seed", range(20))
def test_distances_are_those_of_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
    corners = np.stack([np.cos(angles), 2 * np.sin(angles)], axis=1)
    if seed % 2:
        corners = corners[::-1]
    points_ = rng.uniform(-3, 3, (200, 2))
    found = signed_distance(corners_of(tuple(map(tuple, corners.tolist()))), points_.astype(Long)).astype(float)
    shape = Polygon(corners)
    wanted = [
        -shape.exterior.distance(Point(p)) if shape.contains(Point(p)) else shape.distance(Point(p)) for p in points_
    ]
    assert np.abs(found - wanted).max() < 1e-12


def _random_signal(rng: np.random.Generator) -> Signal:
    """A signal on [0, 10]."""
    inner = np.sort(rng.uniform(0, 10, int(rng.integers(1, 8))))
    t = np.concatenate([[0.0], inner, [10.0]]).astype(Long)
    return Signal(t, rng.normal(size=len(t)).astype(Long))


@pytest.mark.parametrize("seed", quick(range(60), *range(12)))
def test_the_monitor_agrees_with_dense_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    f, g = _random_signal(rng), _random_signal(rng)
    low, high = np.sort(rng.uniform(0, 4, 2)).astype(Long)
    if seed % 7 == 0:
        high = low
    fine = np.unique(np.concatenate([np.linspace(0, 10, 2001).astype(Long), f.t, g.t]))
    for time in rng.uniform(0, 5, 3).astype(Long):
        times = np.unique(np.concatenate([fine[fine >= time], [time, time + low, time + high]]))
        inside = (times >= time + low) & (times <= time + high)
        slope = max(float(np.abs(np.diff(s.y) / np.diff(s.t)).max()) for s in (f, g))
        near = slope * 0.01 + 1e-12
        at = np.array([time])

        def agrees(signal: Signal, wanted: Longs, at: Longs = at, near: float = near) -> None:
            found = signal.at(at)[0]
            assert wanted.max() - 1e-12 <= found <= wanted.max() + near

        agrees(monitor.eventually(f, low, high), f.at(times)[inside])
        agrees(monitor.eventually_rest(f), f.at(times))
        held = np.minimum(g.at(times), np.minimum.accumulate(f.at(times)))
        assert abs(float(monitor.until_rest(f, g).at(at)[0] - held.max())) <= near
        assert abs(float(monitor.until_window(f, g, low, high).at(at)[0] - held[inside].max())) <= near
        twice = monitor.eventually(-monitor.eventually(-f, low, high), Long(0), Long(1))
        outer = times[times <= time + 1]
        inner = [f.at(np.append(fine[(fine > t + low) & (fine < t + high)], [t + low, t + high])).min() for t in outer]
        agrees(twice, np.array(inner), near=3 * near)


def test_an_until_ends_where_its_window_still_fits() -> None:
    left, right = (Signal(np.array([0, end], dtype=Long), np.zeros(2, Long)) for end in (6, 8))
    assert monitor.until_window(left, right, Long(1), Long(3)).t[-1] == 3
    assert monitor.until_window(right, left, Long(1), Long(3)).t[-1] == 3
    assert monitor.until_rest(left, right).t[-1] == 6
    # x = t, and the left side is 9.5 - (t + 1): 2.5 at t = 6, the last at which the window fits; -0.5 at t = 9
    task = ("G", None, None, ("U", 0.0, 3.0, ("F", 1.0, 1.0, ("pred", -1.0, 0.0, 9.5)), ("pred", 1.0, 0.0, 99.0)))
    assert Oracle(case_of(task=task)).worst(task) == pytest.approx(2.5, abs=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_what_is_driven_through_between_times_is_seen(seed: int) -> None:
    case = of_family("shares", np.random.default_rng(seed))
    sides = tuple((float(x), float(y)) for x, y in np.random.default_rng(seed).uniform(-1, 1, (3, 2)))
    oracle, duty = Oracle(case), Duty("o", (sides, ((3.0, 0.0), (4.0, 0.0), (3.0, 1.0))), 0.1, 0.0, case.duration)
    times = oracle._times(Long(0), Long(case.duration))
    found, when = oracle.lowest_on_chords(duty, oracle.members, times)
    fine = np.linspace(0, case.duration, 20_001).astype(Long)
    wanted = oracle.distances(duty, oracle.members, fine).min(axis=1)
    speed = float(np.abs(np.array(case.controls)[:, 0]).max()) * float(np.abs(oracle.ends).max())
    error = float(oracle.knots[1]) + 1e-12
    assert (found <= wanted + error).all()
    assert (found >= wanted - error - speed * case.duration / 20_000).all()
    there = np.diagonal(oracle.distances(duty, oracle.members, when)).astype(float)
    assert np.abs(there - found.astype(float)).max() <= error


@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=lambda distribution: distribution[0])
def test_distributions_have_one_mean_and_one_range(distribution: Distribution) -> None:
    x, w = points(distribution, 24)
    share = (0.5 + np.arange(4000)) / 4000
    values = quantiles(distribution, share)
    assert float(w.sum()) == pytest.approx(1.0, abs=1e-15)
    assert float((w * x).sum()) == pytest.approx(values.mean(), abs=1e-4)
    assert ends_of(distribution)[0] <= values.min() <= values.max() <= ends_of(distribution)[1]


def test_known_truths() -> None:
    box = {"o": (((3.5, -1.0), (4.5, -1.0), (4.5, 1.0), (3.5, 1.0)),)}
    case = case_of(obstacles=box, task=("G", 4.0, 4.000000005, ("avoid", "o")))
    assert judge(case).truth == pytest.approx(-0.5, abs=1e-8)
    inner = ("G", 0.0, 0.4567891, ("pred", -1.0, 0.0, 5.0))
    assert Oracle(case_of()).worst(("G", None, None, inner)) == pytest.approx(-5.0, abs=1e-12)
    late = ("G", 0.0, 5.0000009, ("pred", -1.0, 0.0, 5.0000005))
    assert Oracle(case_of(task=late)).worst(late) == pytest.approx(-4e-7, rel=1e-6)
    first = ("F", 0.0, 3.3, ("F", 0.0, 3.3, ("pred", 1.0, 0.0, -7.0)))
    assert Oracle(case_of(task=first)).worst(first) == pytest.approx(-0.4, abs=1e-12)


def test_a_case_is_made_again_from_its_index() -> None:
    assert make(0, 17) == make(0, 17) != make(0, 18)
    assert {name for name, (weight, _) in FAMILIES.items() if weight} == {
        make(0, index).family for index in range(2000)
    }
    assert text(("U", 0.0, 1.0, ("in", "r"), ("pred", 1.0, -2.0, 3.0))).startswith("((in(r)) U[0.0, 1.0] (")


def test_drawn_members_have_the_weight_of_the_fleet() -> None:
    rows, weights = drawn(case_of(parameters={"traction": ("samples", (0.9, 1.0, 1.1))}), 32)
    assert rows.ravel().tolist() == [0.9, 1.0, 1.1]
    assert float(weights.sum()) == pytest.approx(1.0)
