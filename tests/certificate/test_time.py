"""Windows on, off and next to the grid, tiny and zero, judged by closed-form arcs at dense times."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ensemble_ctrl import ProblemError, load_text
from ensemble_ctrl.certificate import certify
from ensemble_ctrl.certificate import schedule as schedule_module
from ensemble_ctrl.certificate.clearance import TIGHT, Prover
from ensemble_ctrl.certificate.enclosure import Flow
from ensemble_ctrl.certificate.instants import Spans
from ensemble_ctrl.certificate.remaining import certify_set
from ensemble_ctrl.certificate.schedule import Schedule, extremes
from ensemble_ctrl.constraints.stl import Predicate, negation_normal_form, parse
from ensemble_ctrl.problem import Problem
from ensemble_ctrl.report.words import certificate_words
from tests.examples import examples

from .monitor import Floats, Signal, always, box_distance, driven, eventually, until

STRAIGHT = np.tile([1.0, 0.0], (10, 1))
"""One metre a second for ten seconds."""


def problem_of(
    task: str, steps: int = 10, duration: str = "10 s", box: object = None, parameters: str = "{}"
) -> Problem:
    """A unicycle at the origin, towards +x, and an obstacle `o`."""
    obstacles = "" if box is None else f"obstacles: {{o: {{box: {box}}}}}"
    return load_text(
        f"""
        fleet: {{model: unicycle, parameters: {parameters}, start: {{position: [0, 0], heading: 0 deg}}}}
        horizon: {{duration: {duration}, steps: {steps}}}
        {obstacles}
        task: {task}
        """
    )


@pytest.mark.parametrize(
    ("window", "box"),
    [
        ((4.0, 4.000000005), [[3.5, 4.5], [-1.0, 1.0]]),
        ((4.0, 4.0), [[3.5, 4.5], [-1.0, 1.0]]),
        ((3.999999999, 4.0), [[3.5, 4.5], [-1.0, 1.0]]),
        ((10.0, 10.0), [[9.5, 10.5], [-1.0, 1.0]]),
        ((4.5, 10.0), [[3.9, 4.2], [-1.0, 1.0]]),
        ((2.0, 2.0), [[1.4, 1.6], [-0.1, 0.1]]),
        ((2.0, 2.0), [[2.4, 2.6], [-0.1, 0.1]]),
        ((0.0, 1.3), [[1.5, 1.6], [-0.1, 0.1]]),
        ((2.25, 2.75), [[2.05, 2.1], [-0.1, 0.1]]),
        ((2.25, 2.75), [[2.3, 2.4], [-0.1, 0.1]]),
        ((2.7, 2.7), [[2.71, 2.9], [-0.1, 0.1]]),
    ],
)
@pytest.mark.parametrize("text", ["G[{}, {}] avoid(o)", "not F[{}, {}] not avoid(o)"])
def test_only_the_window_counts_and_all_of_it(text: str, window: tuple[float, float], box: list[list[float]]) -> None:
    certificate = certify(problem_of(text.format(*window), box=box), STRAIGHT)
    truth = float(box_distance(box, driven(STRAIGHT, 1.0, np.linspace(*window, 10_001))).min())
    assert certificate.proven == ("yes" if truth > 0 else "no")
    bounds = certificate.clearances or certificate.parts
    assert bounds[0].proven <= truth + 1e-9
    assert truth - 1e-9 <= bounds[0].sampled
    if truth > 0 or certificate.clearances:
        assert truth - 1e-3 <= bounds[0].proven
        assert bounds[0].sampled <= truth + 1e-3
    if certificate.clearances and certificate.counter_example is not None:
        time = certificate.counter_example.time
        assert time is not None
        assert window[0] - 1e-12 <= time <= window[1] + 1e-12


def test_a_window_next_to_the_grid_is_not_taken_for_one_on_it() -> None:
    late = certify(problem_of("G[0, 5.0000009] x <= 5.0000005"), STRAIGHT)
    assert late.proven == "no"
    assert late.robustness == pytest.approx(-4e-7, abs=1e-10)
    assert certify(problem_of("G[0, 5.0000004] x <= 5.0000005"), STRAIGHT).proven == "yes"


def test_an_operator_without_a_window_ends_where_its_operand_just_fits() -> None:
    controls = np.array([[0.575, 0.0]] * 8 + [[0.0, -np.pi / 6], [2.0, 5 * np.pi / 3]])
    certificate = certify(problem_of("G (y >= -0.001 or G[0, 0.4567891] x <= 5)"), controls)
    times = np.linspace(0.0, 10.0 - 0.4567891, 2001)
    y = driven(controls, 1.0, times)[:, 1]
    ahead = driven(controls, 1.0, times[:, None] + np.linspace(0.0, 0.4567891, 201))[..., 0]
    truth = np.maximum(y + 0.001, 5 - ahead.max(axis=1)).min()
    assert truth == pytest.approx(-0.05, abs=0.005)
    assert certificate.proven == "no"
    assert certificate.parts[0].proven <= truth <= certificate.parts[0].sampled


def test_nested_windows_off_the_grid_are_answered() -> None:
    task = "F[0,3.3123] F[0,3.3123] F[0,3.3123] x >= 1"
    certificate = certify(problem_of(task, steps=20), np.repeat(STRAIGHT, 2, axis=0))
    assert certificate.proven == "yes"
    assert certificate.robustness == pytest.approx(3 * 3.3123 - 1, abs=1e-9)


def test_a_full_circle_is_cut_in_time() -> None:
    box, controls = [[1.5, 2.0], [0.0, 2.0]], np.full((1, 2), 2 * np.pi)
    problem = problem_of("G avoid(o)", 1, "1 s", box, "{traction: {range: [0.9, 1.1]}}")
    certificate = certify(problem, controls)
    times = np.linspace(0.0, 1.0, 2001)
    truth = min(box_distance(box, driven(controls, 1.0, times, c)).min() for c in np.linspace(0.9, 1.1, 101))
    assert certificate.proven == "yes"
    assert truth - 1e-3 <= certificate.clearance <= truth + 1e-9


def test_the_last_halving_may_leave_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    box = [[3.0, 4.0], [0.2, 1.0]]
    problem = problem_of("G avoid(o)", box=box, parameters="{traction: {range: [0.9, 1.1]}}")
    found = certify(problem, STRAIGHT).clearances[0]
    for rounds in range(12):
        monkeypatch.setattr("ensemble_ctrl.certificate.clearance.ROUNDS", rounds)
        bound = certify(problem, STRAIGHT).clearances[0]
        assert bound.proven <= found.sampled
        assert bound.sampled >= found.proven


@pytest.mark.parametrize("task", ["F x >= 1", "G avoid(o)", "G[2, 2] avoid(o)"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_commands_that_are_no_numbers_are_refused(task: str, bad: float) -> None:
    controls = STRAIGHT.copy()
    controls[9, 0] = bad
    problem = problem_of(task, box=[[30, 40], [0, 1]])
    for prove in (certify, lambda p, c: certify_set(p, c, 0.0, 0.0)):
        with pytest.raises(ProblemError, match="controls: expected finite"):
            prove(problem, controls)


@pytest.mark.parametrize(
    "task", ["F x >= 1", "G avoid(o)", "G[2, 2] avoid(o)", "mean(F x >= 1)", "share(0.5, F x >= 1)"]
)
@pytest.mark.parametrize("size", [1e155, 1e308])
def test_what_overflows_proves_nothing(task: str, size: float) -> None:
    problem = problem_of(task, box=[[30, 40], [0, 1]], parameters="{traction: {range: [0.9, 1.1]}}")
    certificate = certify(problem, np.tile([size, size], (10, 1)))
    assert certificate.proven == "undecided"


def test_a_step_of_an_obstacle_is_not_lost_between_two_doubles() -> None:
    problem = load_text(
        """
        fleet: {model: unicycle, start: {position: [0, 0], heading: 0 deg}}
        horizon: {duration: 1000 s, steps: 10}
        obstacles: {o: {box: [[100, 101], [-1, 1]]}}
        motions: {o: {path: [[0 s, [0, 0]], [999.3 s, [0, 0]], [999.3000000000001 s, [300, 0]], [1000 s, [300, 0]]]}}
        task: G[999.3, 999.3] avoid(o)
        """
    )
    certificate = certify(problem, np.zeros((10, 2)))
    assert certificate.clearance <= 100


SECONDS = st.one_of(
    st.floats(0.0, 1.4),
    st.sampled_from([0.0, 0.25, 0.5, 1.0, 1.25]),
    st.builds(
        lambda k, e: max(0.0, 0.25 * k + e), st.integers(0, 5), st.sampled_from([1e-12, -1e-12, 1e-7, -1e-7, 3e-6])
    ),
)


@st.composite
def windows(draw: st.DrawFn) -> tuple[float, float]:
    """Long, tiny and zero windows."""
    a = draw(SECONDS)
    width = draw(st.one_of(SECONDS, st.sampled_from([0.0, 1e-9, 1e-6])))
    return a, min(a + width, 1.4) if a <= 1.4 else a


@examples(150)
@given(windows(), windows(), st.integers(0, 6), st.integers(0, 2**31))
def test_bounds_hold_for_windows_anywhere(
    first: tuple[float, float], second: tuple[float, float], kind: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    steps = 12
    controls = rng.uniform(-2, 2, (steps, 2)) * (rng.random((steps, 2)) < 0.8)
    (a, b), (c, d) = first, second
    fx, gx = f"F[{a!r},{b!r}]", f"G[{a!r},{b!r}]"
    fy, gy = f"F[{c!r},{d!r}]", f"G[{c!r},{d!r}]"

    def x(level: float) -> Signal:
        return lambda times: driven(controls, 0.25, times)[..., 0] - level

    def y(level: float) -> Signal:
        return lambda times: level - driven(controls, 0.25, times)[..., 1]

    def negative(signal: Signal) -> Signal:
        return lambda times: -signal(times)

    def both(left: Signal, right: Signal) -> Signal:
        return lambda times: np.minimum(left(times), right(times))

    until_ = f"x >= 0.1 U[{a!r},{b!r}] y <= 0.2"
    text, truth = [
        (f"{fx} {gy} x >= 0.2", eventually(a, b, always(c, d, x(0.2)))),
        (f"{gx} {fy} y <= 0.1", always(a, b, eventually(c, d, y(0.1)))),
        (f"{fx} (x >= 0.2 and {fy} y <= 0.1)", eventually(a, b, both(x(0.2), eventually(c, d, y(0.1))))),
        (until_, until(a, b, x(0.1), y(0.2))),
        (f"not ({until_})", negative(until(a, b, x(0.1), y(0.2)))),
        (f"{gx} ({until_.replace(f'[{a!r},{b!r}]', f'[{c!r},{d!r}]')})", always(a, b, until(c, d, x(0.1), y(0.2)))),
        (f"G {fy} y <= 0.1", always(0.0, 3.0 - d, eventually(c, d, y(0.1)))),
    ][kind]
    [bound] = certify(problem_of(text, steps, "3 s"), controls).parts
    seen = float(truth(np.zeros(1))[0])
    slack = 2 * {3: b, 4: b, 5: b - a + d, 6: 3.0}.get(kind, b - a + d - c) / 40  # two metres a second between looks
    assert bound.covered
    assert bound.proven <= seen + slack + 1e-9
    assert bound.sampled >= seen - slack - 1e-9
    assert bound.sampled - bound.proven <= 0.2 or np.sign(bound.proven) == np.sign(bound.sampled)


class Steps:
    """Bounds that are the numbers themselves: a step function of one member."""

    members, upper = 1, False

    def __init__(self, value: Floats) -> None:
        self.value = value

    def leaf(self, predicate: Predicate, first: int, last: int) -> Floats:
        return self.value[None, first : last + 1]

    def mean(self) -> Steps:
        return self

    def ranked(self, value: Floats, share: object) -> Floats:
        return value


@pytest.mark.parametrize("most", [20_000, 5])
@examples(60)
@given(
    st.integers(0, 2**31),
    st.sampled_from(
        [
            "F[0,{a}] G[{c},{d}] x >= 0",
            "G[0,{a}] F[{c},{d}] x >= 0",
            "F[0,{a}] (x >= 0 U[{c},{d}] x >= 0)",
            "G[0,{a}] F x >= 0",
        ]
    ),
)
def test_fewer_instants_lower_the_value(most: int, seed: int, text: str) -> None:
    rng = np.random.default_rng(seed)
    a, c, width = (round(float(t), 2) for t in rng.uniform(0, 1.6, 3))
    formula = negation_normal_form(parse(text.format(a=a, c=c, d=c + width)))
    schedule = Schedule.of(formula, 5.0, np.full(10, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(schedule_module, "MOST", most)
        coarse = Schedule.of(formula, 5.0, np.full(10, 2))
    assert schedule is not None
    assert coarse is not None
    value = Steps(rng.normal(size=2 * len(schedule.mesh.owner) + 1))
    assert coarse.value(value)[0] <= schedule.value(value)[0]
    if most > 5:
        assert coarse.value(value)[0] == schedule.value(value)[0]


def test_extremes_of_ranges() -> None:
    rng = np.random.default_rng(1)
    value = rng.normal(size=(3, 40))
    first = rng.integers(0, 40, 200)
    last = np.minimum(first + rng.integers(0, 40, 200), 39)
    wanted = np.stack([value[:, i : j + 1].max(axis=1) for i, j in zip(first, last, strict=True)], axis=1)
    assert (extremes(value, first, last, np.maximum) == wanted).all()


@given(st.floats(0, 3), st.floats(0, 3), st.integers(1, 50))
def test_spans_cover_the_window_and_no_more(one: float, other: float, steps: int) -> None:
    begin, end = sorted((one, other))
    spans = Spans.of(begin, end, 3.0, steps)
    step = Fraction(3, steps)
    low = (Fraction(int(spans.step[0])) + Fraction(float(spans.begin[0]))) * step
    high = (Fraction(int(spans.step[-1])) + Fraction(float(spans.end[-1]))) * step
    assert float(low) == pytest.approx(begin, abs=1e-15)
    assert float(high) == pytest.approx(end, abs=1e-15)
    assert (np.diff(spans.step) == 1).all()
    assert (spans.begin[1:] == 0).all()
    assert (spans.end[:-1] == 1).all()


def test_far_boxes_are_looked_at_where_they_are() -> None:
    problem = problem_of("G[4.5, 4.75] avoid(o)", box=[[3.9, 4.2], [-1.0, 1.0]])
    prover = Prover(Flow.of(problem, STRAIGHT), ())
    bound = prover.bound("o", problem.obstacles["o"][0], Spans.of(4.5, 4.75, 10.0, 10), 0.0)
    assert bound.sampled == pytest.approx(0.3, abs=1e-9)
    assert 0.3 - TIGHT <= bound.proven <= 0.3


@pytest.mark.parametrize(("end", "steps"), [(4.0, [3, 4]), (4.000000005, [3, 4]), (4.5, [4]), (3.9, [])])
def test_a_plan_keeps_out_in_windows_that_are_about_an_instant(end: float, steps: list[int]) -> None:
    begin = min(4.0, end)
    [avoid] = problem_of(f"G[{begin!r}, {end!r}] avoid(o)", box=[[30, 40], [0, 1]]).specification.avoid
    assert np.flatnonzero(avoid.steps(10, 10.0)).tolist() == (steps or [3])


@pytest.mark.parametrize(
    "distribution", ["range: [0.9, 1.1]", "distribution: normal, mean: 1.0, deviation: 0.04, range: [0.9, 1.1]"]
)
@pytest.mark.parametrize("task", ["mean(F[10, 10] x >= {})", "share(0.25, F[10, 10] x >= {})", "share(0.9, G x <= {})"])
def test_what_the_fleet_does_not_do_is_refuted(distribution: str, task: str) -> None:
    """Straight on for 10 s, the place at the end is ten times the traction."""
    distribution_ = load_text(TEXT_OF_DISTRIBUTION.format(distribution)).fleet.parameters["traction"]
    places = 10 * np.asarray(distribution_.quantile(np.linspace(0.0, 1.0, 20_001)))
    truth = {"mean": float(places.mean()), "share(0.25": places[15_000], "share(0.9": places[18_000]}
    level = next(value for name, value in truth.items() if task.startswith(name))
    for away, proven in ((0.03, "yes"), (-0.03, "no")):
        bound = level - away if ">=" in task else level + away
        certificate = certify(
            problem_of(task.format(float(bound)), parameters=f"{{traction: {{{distribution}}}}}"), STRAIGHT
        )
        assert certificate.proven == proven
    assert certificate.counter_example is not None
    assert certificate.counter_example.parameters == {}
    assert certificate.counter_example.amount == pytest.approx(0.03, abs=0.02)
    assert certificate.counter_example.amount <= 0.03 + 1e-3
    assert certificate_words(problem_of("F x >= 1"), certificate).lead.startswith("Refuted: the fleet breaks")


TEXT_OF_DISTRIBUTION = """
fleet: {{model: unicycle, parameters: {{traction: {{{}}}}}, start: {{position: [0, 0], heading: 0 deg}}}}
horizon: {{duration: 10 s, steps: 10}}
task: F x >= 1
"""
