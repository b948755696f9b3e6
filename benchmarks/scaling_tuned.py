"""The tuned hand-written program on another number of steps and other boxes: ``scaling_tuned.py JSON``.

The JSON has ``steps``, ``boxes`` and ``members``; with members, nothing is planned, but that many robots are replayed
along the first guess, as the judge replays nine.
"""

from __future__ import annotations

import json
import sys

import fleet_problem as data
import numpy as np


def main() -> None:
    """Change the problem's data, then run the program as it is."""
    asked = json.loads(sys.argv[1])
    data.STEPS = asked["steps"]
    data.DT = data.HORIZON / data.STEPS
    data.WINDOW = data.STEPS * 7 // 8
    data.OBSTACLES = tuple(map(tuple, asked["boxes"]))  # type: ignore[assignment]
    sys.argv = sys.argv[:1]
    import tuned_opti  # reads the data as it is imported

    if not asked["members"]:
        tuned_opti.main()
        return
    v, omega = tuned_opti.route_guess(tuned_opti.BETWEEN)
    p = data.simulate(v, omega, np.linspace(0.9, 1.1, asked["members"]))
    clearance = min(float((-data.depths(p, box)).max(axis=-1).min()) for box in data.OBSTACLES)
    print(json.dumps({"members": asked["members"], "min_clearance": clearance}))


if __name__ == "__main__":
    main()
