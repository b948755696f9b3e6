"""Signal Temporal Logic: formulas, their text, and their robustness."""

from ensemble_ctrl.constraints.stl.check import check_names, check_windows, horizon, name_errors
from ensemble_ctrl.constraints.stl.formula import (
    Always,
    And,
    Eventually,
    Formula,
    Mean,
    Not,
    Or,
    Release,
    Share,
    Until,
)
from ensemble_ctrl.constraints.stl.implied import outermost, without_implied
from ensemble_ctrl.constraints.stl.leaves import Apart, Avoid, Inside, Known, Predicate, Within
from ensemble_ctrl.constraints.stl.operations import Backend, ExactOps, NumpyBackend, Ops, SmoothOps
from ensemble_ctrl.constraints.stl.progression import progressed, settled
from ensemble_ctrl.constraints.stl.rewrite import (
    conjuncts,
    ground,
    kept_out,
    leaves,
    negation_normal_form,
    reads_fleet,
    resolve,
)
from ensemble_ctrl.constraints.stl.robustness import member_robustness, robustness
from ensemble_ctrl.constraints.stl.signals import Signals, StateSignals
from ensemble_ctrl.constraints.stl.text import FormulaError, parse

__all__ = [
    "Always",
    "And",
    "Apart",
    "Avoid",
    "Backend",
    "Eventually",
    "ExactOps",
    "Formula",
    "FormulaError",
    "Inside",
    "Known",
    "Mean",
    "Not",
    "NumpyBackend",
    "Ops",
    "Or",
    "Predicate",
    "Release",
    "Share",
    "Signals",
    "SmoothOps",
    "StateSignals",
    "Until",
    "Within",
    "check_names",
    "check_windows",
    "conjuncts",
    "ground",
    "horizon",
    "kept_out",
    "leaves",
    "member_robustness",
    "name_errors",
    "negation_normal_form",
    "outermost",
    "parse",
    "progressed",
    "reads_fleet",
    "resolve",
    "robustness",
    "settled",
    "without_implied",
]
