"""Swing-ups, spin flips and unstable plants: where known commands take the fleet is what the task asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from .case import Case, text_of
from .plants import START, CartPole, Escape, Pendulum, Spin, pushes
from .tube import Tube, driven

MODELS = (Pendulum, CartPole, Escape, Spin)
LENGTHS = {Pendulum: (4.0, 40), CartPole: (1.6, 32), Escape: (3.0, 30), Spin: (4.0, 40)}
"""Seconds and steps."""
SPREAD = {Pendulum: 0.02, CartPole: 0.01, Escape: 0.03, Spin: 0.05}
"""How far the parameter is from its middle, at most, as a share of it."""


def plants(seed: int, rng: Generator) -> Case:
    """A pendulum, a pole on a cart, a state that escapes, and a spin that turns over, in turn."""
    model = MODELS[seed % len(MODELS)]
    duration, steps = LENGTHS[model]
    ((name, middle),) = model.parameters.items()
    fleet: dict[str, Any] = {
        "model": {"python": f"plants.py:{model.__name__}"},
        "parameters": {name: {"range": [middle * (1 - SPREAD[model]), middle * (1 + SPREAD[model])]}},
        "start": dict(START[model]),
    }
    controls = pushes(model, rng, steps, duration / steps)
    tube = driven(fleet, duration, controls)
    data = {
        "version": 1,
        "name": f"plants_{seed:02d}",
        "fleet": fleet,
        "horizon": {"duration": duration, "steps": steps},
        "task": _reached(model.states, tube, duration),
        "objective": {"robustness": 0.1, "effort": 0.01},
    }
    return Case("plants", seed, text_of(data), controls)


def _reached(states: tuple[str, ...], tube: Tube, duration: float) -> str:
    """Within a box of all states in the last fifth of a second, and within bounds all the time."""
    last = tube.states[:, tube.times >= duration - 0.2 - 1e-9]
    parts = []
    for k, name in enumerate(states):
        low, high = last[..., k].min(), last[..., k].max()
        room = 0.1 + 0.3 * (high - low)
        parts.append(f"{name} >= {low - room:.4f} and {name} <= {high + room:.4f}")
    bound = float(np.abs(tube.states[..., 0]).max()) + 0.5
    whole = f"G ({states[0]} <= {bound:.4f} and {states[0]} >= {-bound:.4f})"
    return f"G[{duration - 0.2:g},{duration:g}] ({' and '.join(parts)}) and {whole}"
