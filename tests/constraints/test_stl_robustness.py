import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ensemble_ctrl.constraints import Obstacle, Polyhedron
from ensemble_ctrl.constraints.stl import (
    ExactOps,
    Inside,
    Not,
    Predicate,
    Release,
    SmoothOps,
    StateSignals,
    Until,
    check_windows,
    ground,
    member_robustness,
    negation_normal_form,
    parse,
    robustness,
)
from ensemble_ctrl.constraints.stl.formula import Formula
from ensemble_ctrl.constraints.stl.operations import Ops
from ensemble_ctrl.core.errors import ProblemError
from tests.examples import examples

from .stl_strategies import NAMES, formulas, look_ahead, naive, predicates, signals

EXACT = ExactOps()
random_formulas = formulas(predicates(), st.sampled_from([0.0, 0.5, 1.0, 1.6, 3.0]))


def fits(formula: Formula, data: StateSignals) -> bool:
    """Whether a random formula can be read on a signal at all."""
    try:
        member_robustness(formula, data, EXACT)
    except ProblemError as error:
        if "windows" in str(error):
            return False
        raise
    return True


@examples(300)
@given(random_formulas, st.integers(0, 1000))
def test_exact_is_the_definition(formula: Formula, seed: int) -> None:
    data = signals(seed)
    assume(fits(formula, data))
    last = min(data.steps - look_ahead(formula, data.step), 4)
    got = member_robustness(formula, data, EXACT, 0, last)
    wanted = np.stack([naive(formula, data, k) for k in range(last + 1)], axis=1)
    np.testing.assert_allclose(got, wanted, atol=1e-9)
    assert robustness(formula, data, EXACT) == pytest.approx(naive(formula, data, 0).min(), rel=1e-12, abs=1e-9)


@examples(200)
@given(random_formulas, st.integers(0, 1000), st.sampled_from([0.01, 1.0, 30.0, 1e6]))
def test_smooth_is_a_lower_bound(formula: Formula, seed: int, sharpness: float) -> None:
    """With no tolerance: the bound holds for the rounded numbers too."""
    data = signals(seed, steps=12)
    assume(fits(formula, data))
    exact = member_robustness(formula, data, EXACT)
    assert (member_robustness(formula, data, SmoothOps(sharpness)) <= exact).all()


@examples(100)
@given(formulas(predicates(), st.sampled_from([0.0, 0.5, 1.0])), st.integers(0, 1000))
def test_smooth_tends_to_exact(formula: Formula, seed: int) -> None:
    assume("share" not in str(formula))
    data = signals(seed, steps=12)
    assume(fits(formula, data))
    exact = robustness(formula, data, EXACT)
    gaps = [exact - robustness(formula, data, SmoothOps(K)) for K in (1.0, 1e3, 1e8)]
    assert 0 <= gaps[2] < 1e-5
    assert gaps[2] <= gaps[1] + 1e-12
    assert gaps[1] <= gaps[0] + 1e-12


@examples(100)
@given(random_formulas, st.integers(0, 1000))
def test_negation_normal_form_keeps_the_robustness(formula: Formula, seed: int) -> None:
    data = signals(seed)
    assume(fits(formula, data))
    normal = negation_normal_form(formula)
    assert not any(isinstance(node, Not) for node in nodes(normal))
    np.testing.assert_array_equal(member_robustness(normal, data, EXACT), member_robustness(formula, data, EXACT))
    opposite = member_robustness(negation_normal_form(formula, negate=True), data, EXACT)
    np.testing.assert_allclose(opposite, -naive(formula, data, 0)[:, None], atol=1e-9)


def nodes(formula: Formula) -> list[Formula]:
    return [formula, *(node for part in formula.parts for node in nodes(part))]


def test_a_huge_sharpness_and_huge_values_do_not_overflow() -> None:
    data = StateSignals(np.full((2, 11, 1), 1e6), ["x"], 0.1)
    with np.errstate(all="raise", under="ignore"):
        for text in ("F x >= 0", "G (x >= 0 or x <= -5)", "x >= 0 U[0,1] x >= 3", "not (x >= 0 U x >= 3)"):
            formula = parse(text)
            exact = robustness(formula, data, EXACT)
            assert robustness(formula, data, SmoothOps(1e6)) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("largest", [True, False])
@pytest.mark.parametrize("width", [0, 1, 2, 3, 7, 8, 29, 30])
@pytest.mark.parametrize("ops", [EXACT, SmoothOps(1e9)])
def test_sliding_windows(ops: Ops, width: int, largest: bool) -> None:
    value = np.random.default_rng(width).normal(size=(4, 30))
    counts = range(1, 31 - max(width, 1))
    pick = np.max if largest else np.min
    for count in [*counts, 1]:
        got = (ops.eventually if largest else ops.always)(value, width, count)
        wanted = [pick(value[:, i : i + width if width else None], axis=1) for i in range(count)]
        np.testing.assert_allclose(got, np.transpose(wanted), atol=1e-6)


@pytest.mark.parametrize("kind", [Until, Release])
def test_exact_and_sharp_until_agree(kind: type[Until] | type[Release]) -> None:
    data = signals(5, steps=30)
    x, y = Predicate((("x", 1.0),), 1.0), Predicate((("y", 1.0),), -2.0)
    for window in [(0, 0), (0, 3), (1, 4.5), (2, 2), (None, None)]:
        formula = kind(x, y, *window)
        got = member_robustness(formula, data, SmoothOps(1e9), 0, 6)
        np.testing.assert_allclose(got, member_robustness(formula, data, EXACT, 0, 6), atol=1e-6)


class Casadi:
    """CasADi's functions under the names of `Backend`."""

    exp, log = staticmethod(ca.exp), staticmethod(ca.log)
    fmax, fmin = staticmethod(ca.fmax), staticmethod(ca.fmin)

    def hstack(self, values: list[ca.SX]) -> ca.SX:
        return ca.horzcat(*values)

    def vstack(self, values: list[ca.SX]) -> ca.SX:
        return ca.vertcat(*values)


class SymbolicSignals:
    """Signals over one CasADi matrix per state; counts the entries that are asked for."""

    def __init__(self, states: dict[str, ca.SX], step: float) -> None:
        self.states, self.step, self.asked = states, step, 0
        self.members, columns = next(iter(states.values())).shape
        self.steps = columns - 1

    def leaf(self, predicate: Predicate, first: int, last: int) -> ca.SX:
        self.asked += last - first + 1
        terms, offset = predicate.normalised()
        total = ca.SX(self.members, last - first + 1) + offset
        for name, c in terms:
            total += c * self.states[name][:, first : last + 1]
        return total

    def mean(self) -> "SymbolicSignals":
        mean = {name: ca.sum1(value) / self.members for name, value in self.states.items()}
        return SymbolicSignals(mean, self.step)


@examples(30)
@given(random_formulas, st.integers(0, 1000))
def test_casadi_gives_numpys_numbers(formula: Formula, seed: int) -> None:
    data = signals(seed, steps=12)
    assume(fits(formula, data))
    symbols = {name: ca.SX.sym(name, data.members, data.steps + 1) for name in NAMES}
    value = robustness(formula, SymbolicSignals(symbols, data.step), SmoothOps(7.0, Casadi()))  # type: ignore[arg-type]
    function = ca.Function("f", list(symbols.values()), [value])
    got = float(function(data.states[:, :, 0], data.states[:, :, 1]))
    assert got == pytest.approx(robustness(formula, data, SmoothOps(7.0)), abs=1e-9)


def test_the_walk_asks_only_for_the_times_it_needs() -> None:
    symbols = {name: ca.SX.sym(name, 2, 161) for name in NAMES}
    data = SymbolicSignals(symbols, 0.1)
    value = robustness(parse("F[14,16] x >= 0"), data, SmoothOps(10.0, Casadi()))  # type: ignore[arg-type]
    assert data.asked == 21
    slope = ca.Function("g", [symbols["x"]], [ca.gradient(value, symbols["x"])])(np.zeros((2, 161)))
    np.testing.assert_allclose(float(ca.sum1(ca.sum2(slope))), 1.0)
    assert not np.any(np.array(slope)[:, :140])


def test_places_are_margins_and_clearances() -> None:
    data = signals(3)
    goal = Polyhedron([[1.0, 2.0], [3.0, -1.0]], [-1.0, -2.0], [4.0, np.inf])
    pieces = [Obstacle.box([[2, 6], [1, 3]]), Obstacle.polygon([[-1, -1], [-3, 0], [-2, -4]])]
    regions = {"goal": goal}
    obstacles: dict[str, Obstacle | list[Obstacle]] = {"o1": pieces, "o2": Obstacle.box([[0, 1], [0, 1]])}

    def value(text: str, radius: float = 0.0) -> NDArray[np.float64]:
        formula = ground(parse(text), regions, obstacles, radius=radius)
        return np.asarray(member_robustness(formula, data, EXACT, 0, data.steps))

    np.testing.assert_allclose(value("in(goal)"), goal.margin(data.states), atol=1e-12)
    np.testing.assert_allclose(value("not in(goal)"), -goal.margin(data.states), atol=1e-12)
    np.testing.assert_allclose(value("avoid(goal)", 0.25), -goal.margin(data.states) - 0.25, atol=1e-12)
    clearance = np.min([piece.facet_clearance(data.states) for piece in pieces], axis=0)
    np.testing.assert_allclose(value("avoid(o1)", 0.25), clearance - 0.25, atol=1e-12)
    np.testing.assert_allclose(value("avoid(obstacles)"), np.minimum(value("avoid(o1)"), value("avoid(o2)")))


def test_the_papers_visit_formula_accepts_a_signal_that_is_never_inside() -> None:
    """`eqVisitWP` asks for one face at a time; `in(region)` sees that both never hold together."""
    path = np.array([0.0, 1.0, 3.0, 4.0])[None, :, None]  # never within [1.5, 2.5]
    data = StateSignals(path, ["x"], 1.0)
    region = Polyhedron([[1.0]], [1.5], [2.5])
    whole = ground(parse("F in(strip)"), {"strip": region}, {}, position=["x"])
    assert robustness(parse("F x >= 1.5 and F x <= 2.5"), data, EXACT) > 0
    assert robustness(whole, data, EXACT) < 0


def test_fleet_readings() -> None:
    states = np.arange(20.0)[:, None, None] * np.ones((1, 3, 1))
    data = StateSignals(states, ["x"], 1.0)
    assert robustness(parse("x >= 5"), data, EXACT) == -5
    assert robustness(parse("mean(x >= 5)"), data, EXACT) == 4.5
    assert robustness(parse("share(0.75, x >= 5)"), data, EXACT) == 0
    assert robustness(parse("not share(0.75, x >= 5)"), data, EXACT) == 0
    assert robustness(parse("share(0.95, x >= 5)"), data, EXACT) == -4
    assert robustness(parse("share(1, x >= 5)"), data, EXACT) == -5


def test_a_window_without_numbers_ends_where_the_operand_still_fits() -> None:
    states = np.array([3.0, 2.0, 1.0, -7.0])[None, :, None]
    data = StateSignals(states, ["x"], 1.0)
    assert robustness(parse("G x >= 0"), data, EXACT) == -7
    assert robustness(parse("G F[0,1] x >= 0"), data, EXACT) == 1
    with pytest.raises(ProblemError, match="windows"):
        robustness(parse("G[0,3] F[0,1] x >= 0"), data, EXACT)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("x >= 0", 0),
        ("F[1,2] G[0,3] x>=0", 5),
        ("G F[0,2] x>=0", 2),
        ("F[0,T] x>=0 and y>=0 U[1,9] x>=0", 16),
    ],
)
def test_horizon(text: str, seconds: float) -> None:
    assert check_windows(parse(text), 16.0) == seconds


@pytest.mark.parametrize(
    ("text", "column"),
    [("F[14,18] x>=0", 1), ("x>=0 and G[0,10] F[0,7] x>=0", 18), ("F[0,1] F[0,T] x>=0", 8)],
)
def test_a_window_past_the_end_has_a_column(text: str, column: int) -> None:
    with pytest.raises(ProblemError, match="16 s, the plan's duration") as caught:
        check_windows(parse(text), 16.0)
    assert caught.value.column == column  # type: ignore[attr-defined]


def test_misuse_is_named() -> None:
    data = signals(0)
    with pytest.raises(ProblemError, match="ground"):
        robustness(Inside("goal"), data, EXACT)
    with pytest.raises(ProblemError, match="grid"):
        robustness(parse("F[0.1,0.2] x >= 0"), data, EXACT)
    with pytest.raises(ProblemError, match="time"):
        robustness(parse("x >= 0"), data, EXACT, time=99)
    with pytest.raises(ProblemError, match="sharpness"):
        SmoothOps(0.0)
    with pytest.raises(ProblemError, match="states x, y"):
        robustness(parse("z >= 0"), data, EXACT)
    with pytest.raises(ProblemError, match="obstacle"):
        ground(parse("avoid(obstacles)"), {}, {})
    with pytest.raises(ProblemError, match="region"):
        ground(parse("in(goal)"), {}, {})


def test_windows_are_rounded_to_the_grid_without_drift() -> None:
    """0.3 / 0.1 is 2.9999999999999996 in floating point; the step at 0.3 s belongs to the window."""
    states = np.array([0.0, 0, 0, 5, 0])[None, :, None]
    data = StateSignals(states, ["x"], 0.1)
    assert robustness(parse("F[0.3,0.3] x >= 0"), data, EXACT) == 5
    assert robustness(parse("F[0.05,0.3] x >= 0"), data, EXACT) == 5
    assert robustness(parse("F[0.31,0.4] x >= 0"), data, EXACT) == 0


@pytest.mark.parametrize("text", ["G (x >= 0 or y >= x)", "x <= 3 U[2,4] 2*x - y >= 1", "share(0.9, F x >= 5)"])
def test_many_members_are_walked_over_in_blocks(text: str) -> None:
    data = signals(1, members=2000, steps=40)
    whole = member_robustness(parse(text), data, EXACT)
    if "share" in text:
        rows = member_robustness(parse("F x >= 5"), data, EXACT)
        np.testing.assert_array_equal(whole, np.full((2000, 1), np.sort(rows[:, 0])[2000 - 1800]))
        return
    for first in (0, 700, 1998):
        part = StateSignals(data.states[first : first + 2], NAMES, data.step)
        np.testing.assert_array_equal(whole[first : first + 2], member_robustness(parse(text), part, EXACT))
