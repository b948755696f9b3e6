"""How the solver converged: IPOPT's own tables, read from the log of a run."""

from __future__ import annotations

import re

from ensemble_ctrl.core.deferred import dataclass

_ROW = re.compile(r"^ *(\d+)r? +([-+0-9.eE]+) +([0-9.eE+-]+) +[0-9.eE+-]+ ", re.MULTILINE)
LARGEST = 2_000_000
"""Characters of a log that are read, from its end: what came of the search stands last."""


@dataclass(frozen=True)
class Descent:
    """One solve.

    Attributes
    ----------
    objective : tuple of float
        After each iteration, the start included.
    violation : tuple of float
        Largest violation of a constraint, scaled as IPOPT does.
    """

    objective: tuple[float, ...]
    violation: tuple[float, ...]


def descents(log: str) -> tuple[Descent, ...]:
    """The solves in a log, in order; an iteration 0 begins one. What is no table of IPOPT's is passed over.

    Examples
    --------
    >>> log = '''
    ... iter    objective    inf_pr   inf_du lg(mu)  ||d||  lg(rg) alpha_du alpha_pr  ls
    ...    0  7.3180704e+00 6.28e-02 5.09e+00  -2.0 0.00e+00    -  0.00e+00 0.00e+00   0
    ...    1r 3.6212054e+00 5.89e-02 5.63e+00  -2.0 2.00e-01   0.0 8.39e-01 1.09e-01f  1
    ... '''
    >>> descents(log)
    (Descent(objective=(7.3180704, 3.6212054), violation=(0.0628, 0.0589)),)
    """
    found: list[tuple[list[float], list[float]]] = []
    for count, objective, violation in _ROW.findall(log[-LARGEST:]):
        try:
            values = float(objective), float(violation)
        except ValueError:
            continue
        if int(count) == 0:
            found.append(([], []))
        if found:
            found[-1][0].append(values[0])
            found[-1][1].append(values[1])
    return tuple(Descent(tuple(objective), tuple(violation)) for objective, violation in found)
