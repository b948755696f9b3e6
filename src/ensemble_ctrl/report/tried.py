"""What a search tried that found no plan: how many guesses of which kind, and how close the nearest came."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

KINDS = {
    "route": ("route", "routes"),
    "itinerary": ("itinerary", "itineraries"),
    "middle": ("plan of the middle member", "plans of the middle member"),
    "widened": ("guess for ranges that widen", "guesses for ranges that widen"),
    "pivot": ("route with turns on the spot", "routes with turns on the spot"),
    "curve": ("curve that the robots can drive", "curves that the robots can drive"),
    "random": ("guess with random commands", "guesses with random commands"),
    "start": ("other start for the whole fleet", "other starts for the whole fleet"),
    "tree": ("way found for several members", "ways found for several members"),
    "state tree": ("way found by trying commands", "ways found by trying commands"),
    "timing": ("other timing of the best way", "other timings of the best way"),
    "waves": ("guess with waves added", "guesses with waves added"),
}
"""Words for one guess of a kind, and for several."""
RUNAWAY = 1e5
"""A guess under which states leave all bounds falls short by more, and no figure describes it."""
MISSING = {
    "ompl": "OMPL is not installed: with it, curves that reverse and trees of commands are tried too (pip install ompl)"
}
"""The remark on an optional library that would have been used."""
CLOSED = "no passage between the obstacles leads to {}, so no other guesses were tried"


def tried(details: dict[str, Any]) -> Iterator[str]:
    """The guesses of each kind in words, and what could not be tried; nothing for a plan of an earlier version."""
    found = [route for route in details.get("routes", []) if "kind" in route]
    parts = [_kind(kind, [r for r in found if r["kind"] == kind]) for kind in dict.fromkeys(r["kind"] for r in found)]
    if parts:
        yield "; ".join(parts)
    if closed := details.get("closed"):
        yield CLOSED.format(" or ".join(closed))
    yield from (MISSING[name] for name in details.get("missing", []) if name in MISSING)


def _kind(kind: str, routes: list[dict[str, Any]]) -> str:
    """The guesses of one kind."""
    one, many = KINDS.get(kind, (kind, kind))
    words = f"{len(routes)} {one if len(routes) == 1 else many}"
    short = min(route["short"] for route in routes)
    return f"{words}, the nearest short by {short:.3g}" if 0 < short < RUNAWAY else words


__all__ = ["tried"]
