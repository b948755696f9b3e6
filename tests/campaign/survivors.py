"""Mutants that no case can find, by what their names begin with (by all of the name before a ``$``), and the reason."""

from __future__ import annotations

FINER = "chooses what is looked at more closely; every choice gives true bounds"
BOX = "chooses the box of members that is tried; what is proven of it is proven whichever it is"
LONG = "step functions of more than 20,000 instants, which no case has; tests/certificate/test_time.py has fewer"
TWICE = "differs where a state is in a sum twice, which no case has; tests/constraints"
CHANGED = "problems that are changed past their constructor, as the loop does; tests/problem/test_specification.py"
FEW = "where bounds are sharp there are few cells, and the rounding of their sum is within the rounding term"
HIDDEN = "hidden by the other term of the remainder, which is larger wherever factors on the speed differ"
LINE = "sets on a line, which no case has"
AROUND = "corners lie around their middle, so that one of them is about as far or further from the origin"
BOTH = "regions that are open to a side, which no case has"
DIGITS = "differs for shares of 17 digits; 1 - p of others is exact"
ENDS = "when a search ends; its bounds are true at any time"
STRAIGHT = (
    "decides corners that are straight but for a rounding, which the rounding term has room for; tests/constraints"
)
LIGHT = "weighs too little of the fleet; then the bound by cells of the whole fleet is taken"
SPARE = "far below the rounding term, which has room for it"
CHOICE = "chooses one of several bounds, each of which is true"
ELSEWHERE = "for the planner, the replay or a picture; no proof of a robot on arcs calls it"
SPACE = "planes in space, which robots on arcs never meet; tests/constraints/test_exact.py has rational arithmetic"
INPUT = "refuses wrong input, which no case has"
DRAWN = "regions and obstacles of cases are drawn otherwise; its own tests compare with rational arithmetic"
TOLD = "what is printed or how long it took; no bound"

REASONS: dict[str, str] = {
    "certificate/clearance.py:Prover.nearness": "the order in which pieces are looked at",
    "certificate/clearance.py:Prover._widths": FINER,
    "certificate/task.py:_bending": FINER,
    "certificate/masses.py:Masses.needed: 1.0 + MASS_ERROR * share.strict": "the same but for shares within 1e-9 of 1",
    "certificate/masses.py:Masses.needed: p + Fraction(": DIGITS,
    "certificate/masses.py:Masses.needed: -1 -> 1": DIGITS,
    "certificate/schedule.py:Coarse": LONG,
    "certificate/clearance.py:Prover.bound: self.boxes - spent > self.limit": ENDS,
    "certificate/schedule.py:Schedule.of: -high -> high": FINER,
    "certificate/schedule.py:Schedule.of: high -> low": FINER,
    "certificate/schedule.py:Schedule.of: low -> high": FINER,
    "certificate/schedule.py:Schedule.of: min((a for a": FINER,
    "certificate/schedule.py:Schedule.of: max((b for _": FINER,
    "certificate/share.py:_values": BOX,
    "certificate/share.py:_value:": BOX,
    "certificate/share.py:_largest": BOX,
    "certificate/share.py:_longest": BOX,
    "certificate/share.py:_peeled": BOX,
    "certificate/share.py:boxes: -1 -> 1$": BOX,
    "certificate/share.py:boxes: low -> high$": LIGHT,
    "certificate/share.py:boxes: high -> low$": LIGHT,
    "certificate/share.py:_certain": "weighs less of the fleet, or by 1e-9 of it more, which no case can tell",
    "certificate/share.py:_ends": BOX,
    "certificate/share.py:boxes: _value(": BOX,
    "certificate/share.py:boxes: value >= spare": BOX,
    "certificate/certify.py:Certificate.__repr__": TOLD,
    "certificate/certify.py:certify: time.perf_counter() - began": TOLD,
    "certificate/certify.py:unproven": "the ranges told with a proof that was not finished, which claims nothing",
    "certificate/bound.py:nearest_piece: min([enough, *(b.sampled for b in found)])": FINER,
    "certificate/certify.py:part_bound": FINER,
    "certificate/certify.py:_share: found.proven > best.proven": CHOICE,
    "certificate/certify.py:_share: best.proven >= 0 ->": CHOICE,
    "certificate/certify.py:_share: best.proven >= found.proven": CHOICE,
    "certificate/certify.py:_share: found.proven >= 0 ->": CHOICE,
    "certificate/enclosure.py:Flow.remainder_at: (A * (B * I1 + G * I0) + self.fastest / 2 * quadratic) * (1 +": SPARE,
    "certificate/enclosure.py:Flow.growth: span ** 2 / 8 * np.abs(self.v[n] * self.omega[n]) * size * (1 +": SPARE,
    "certificate/enclosure.py:Flow.shift: (self.upper - self.lower) / 2 + UNIT * np.maximum(np.abs(self.lower), "
    "np.abs(self.upper)) -> (self.upper": SPARE,
    "certificate/enclosure.py:Flow.shift: np.maximum(": SPARE,
    "certificate/enclosure.py:Flow.shift: self.lower -> self.upper #2": SPARE,
    "certificate/enclosure.py:Flow.shift: self.upper -> self.lower #2": SPARE,
    "certificate/enclosure.py:Flow.shift: half @ np.abs(self.directions[:, START]) * (1 +": SPARE,
    "certificate/enclosure.py:Flow.shift: 1 + 4 * UNIT -> 1": SPARE,
    "constraints/exact.py:corner_turns: FILTER": STRAIGHT,
    "constraints/exact.py:_chain: turn(": "the hull the other way round; every direction still proves a true bound",
    "constraints/exact.py:turn: abs(one - other) >": STRAIGHT,
    "constraints/exact.py:turn: FILTER": STRAIGHT,
    "constraints/exact.py:turn: abs(one) + abs(other)": STRAIGHT,
    "constraints/exact.py:corner_turns: np.abs(one - other) <=": STRAIGHT,
    "constraints/exact.py:corner_turns: np.abs(one) + np.abs(other)": STRAIGHT,
    "constraints/exact.py:_rational_turn": STRAIGHT,
    "constraints/exact.py:space_corners": SPACE,
    "constraints/exact.py:_maybe_inside": SPACE,
    "constraints/exact.py:_plane_crossing": SPACE,
    "constraints/polygon.py:facets: -1 -> 1": SPARE,
    "constraints/polygon.py:facets: np.abs(corners).max()": SPARE,
    "constraints/polygon.py:facets: A.all(axis=1)": SPARE,
    "constraints/polygon.py:facets: ends.min(axis=0) - allowance": SPARE,
    "constraints/polygon.py:facets: ends.max(axis=0)": DRAWN,
    "constraints/stl/leaves.py:Predicate.__str__": TOLD,
    "constraints/stl/leaves.py:Predicate.__post_init__: total.get(name, 0.0) + float(value) -> float": TWICE,
    "constraints/stl/leaves.py:Predicate.__post_init__: all(map(math.isfinite": INPUT,
    "constraints/stl/implied.py:_window: begin -> end$": "a window has both ends or none",
    "constraints/stl/implied.py:_window: end -> begin$": "a window has both ends or none",
    "certificate/clearance.py:Prover._bounds: corners - middle[:, None]": AROUND,
    "constraints/polyhedron.py:Polyhedron._plane: self.upper -> self.lower$": BOTH,
    "constraints/polyhedron.py:Polyhedron._plane: self.lower -> self.upper$": BOTH,
    "certificate/clearance.py:Prover._near: min(best[0] - TIGHT, enough)": FINER,
    "certificate/clearance.py:Prover.bound: min(best[0] - TIGHT, enough)": FINER,
    "problem/specification.py:Specification.rest": ELSEWHERE,
    "problem/specification.py:Specification.is_of": CHANGED,
    "certificate/signals.py:CellSignals.mean: 1 + len(self.centres) -> 1": FEW,
    "constraints/stl/rewrite.py:leaves": ELSEWHERE,
    "constraints/polyhedron.py:Polyhedron.polygon": DRAWN,
    "constraints/polyhedron.py:Polyhedron.__init__: lower -> upper #2": INPUT,
    "constraints/polyhedron.py:Polyhedron.__init__: upper -> lower #2": INPUT,
    "constraints/polyhedron.py:Polyhedron.is_empty": ELSEWHERE,
    "constraints/polyhedron.py:Polyhedron.vertices: G[:, 0]": LINE,
    "constraints/polyhedron.py:Polyhedron.vertices: (h / G[:, 0])": LINE,
    "constraints/exact.py:intersection: min(corners)": "another corner comes first; the polygon is the same",
    "constraints/polyhedron.py:Polyhedron.contains": ELSEWHERE,
    "constraints/polyhedron.py:Polyhedron.margin": ELSEWHERE,
    "constraints/polyhedron.py:Polyhedron.moment_bounds": ELSEWHERE,
    "constraints/polyhedron.py:Polyhedron.two_sided": ELSEWHERE,
    "constraints/polyhedron.py:Polyhedron._lines": ELSEWHERE,
    "constraints/polyhedron.py:_checked_bound": INPUT,
    "constraints/motion.py:Motion.__post_init__": INPUT,
    "constraints/obstacle.py:Obstacle.edges": "the same sides the other way round; for a picture and other systems",
    "constraints/obstacle.py:Obstacle.big_m_bounds": ELSEWHERE,
    "problem/specification.py:AvoidConstraint.bends": ELSEWHERE,
    "problem/specification.py:AvoidConstraint.steps": ELSEWHERE,
    "problem/specification.py:AvoidConstraint.during": ELSEWHERE,
    "problem/specification.py:AvoidConstraint.distances": ELSEWHERE,
    "problem/specification.py:clearances": ELSEWHERE,
}


def reason_of(name: str) -> str:
    """Why a mutant may survive; empty for one that may not."""
    return next((reason for begin, reason in REASONS.items() if f"{name}$".startswith(begin)), "")


def stale(names: list[str]) -> list[str]:
    """Reasons for mutants that aren't there any more."""
    return [begin for begin in REASONS if not any(f"{name}$".startswith(begin) for name in names)]
