"""What to write in place of what other temporal logics have and this one has not."""

from __future__ import annotations

_PAST = "there are no past operators, a task is read forwards from t = 0: "
_ONCE = _PAST + "'f before g' is  not g U f"
_SO_FAR = _PAST + "'f up to the time b' is  G[0,b] f"
_SINCE = _PAST + "'f from g on' is  G (g => G f)"
_NEXT = "time is continuous and has no next instant: for a step of 0.1 s write  F[0.1,0.1] f"
_EDGE = "there are no edges, a formula is read at each time: 'f is true at some time' is  F f"
_WEAK = "weak until is  (f U g) or G f"
_RELEASE = "release is  not (not f U not g)"
_EQUAL = "an equality can't be kept exactly: write  abs(x - 1) <= 0.1  with the tolerance that you need"
_UNEQUAL = "write  abs(x - 1) >= 0.1  with the distance that you need"
_LINEAR = "predicates are linear in the states: for a shape draw a region and write  in(region)"
_LEAST = "write  a >= 1 and b >= 1  for min(a, b) >= 1, and  a >= 1 or b >= 1  for max(a, b) >= 1"
_WINDOW = "a window stands in square brackets, as in  F[0,5] f"
_UNIT = "numbers in predicates are in SI units and radians, without a unit: 50 cm is 0.5"

HINTS = {
    **dict.fromkeys(["once", "O", "P", "past", "previously"], _ONCE),
    **dict.fromkeys(["historically", "H", "hist"], _SO_FAR),
    **dict.fromkeys(["since", "S", "triggered"], _SINCE),
    **dict.fromkeys(["next", "X", "prev", "previous", "Y", "Z"], _NEXT),
    **dict.fromkeys(["rise", "fall", "changed"], _EDGE),
    **dict.fromkeys(["W", "weak", "unless", "weakuntil"], _WEAK),
    **dict.fromkeys(["R", "release", "releases", "V", "M"], _RELEASE),
    **dict.fromkeys(["alw", "alw_", "henceforth", "throughout"], "'always' is  G"),
    **dict.fromkeys(["ev", "ev_", "sometime", "sometimes"], "'eventually' is  F"),
    **dict.fromkeys(["=", "=="], _EQUAL),
    **dict.fromkeys(["!=", "≠"], _UNEQUAL),
    **dict.fromkeys(["^", "**", "sqrt", "pow", "norm", "sin", "cos", "tan", "exp", "log", "dist"], _LINEAR),
    **dict.fromkeys(["min", "max"], _LEAST),
    "{": _WINDOW,
    **dict.fromkeys(["inside", "reach", "visit"], "to be inside of a place is  in(place)"),
    **dict.fromkeys(["outside", "notin"], "to be outside of a place is  avoid(place)"),
}
"""By the word or symbol that is refused, or that stands right before what is."""


_CALLED = frozenset(["in", "avoid", "mean", "share", "abs"])
"""Words that stand before a bracket."""
_UNITS = frozenset(["cm", "mm", "km", "m", "s", "ms", "min", "h", "deg", "rad"])


def hint_for(before: str, text: str, after_name: bool) -> str:
    """What to write in place of a token that is refused; empty if nothing is known.

    Parameters
    ----------
    before, text : str
        The token in front of the refused one, and that one.
    after_name : bool
        Whether the one in front is a name and no word of the language.
    """
    if before[:1].isdigit() or before[:1] == ".":
        return _after_number(before, text)
    if before in _CALLED and text.isidentifier():
        return f"write  {before}({text})"
    if text in HINTS:
        return HINTS[text]
    if before in HINTS:
        return HINTS[before]
    if not after_name:
        return ""
    if text == "(":
        return f"{before} is no function; there are in(place), avoid(place), mean(f), share(p, f) and abs(x)"
    if text == "[":
        return f"write {before} alone: it is read at the time of the operator around it"
    if text in ("", "and", "or", ")", "&", "|"):
        return f"compare a state as in  {before} >= 1 ; to be inside of a region is  in({before})"
    return ""


def _after_number(before: str, text: str) -> str:
    """What to write where a number is followed by something else than an operator."""
    if text in _UNITS:
        return _UNIT
    if text == ",":
        return _WINDOW
    return HINTS.get(text) or (f"a product is  {before}*{text}" if text.isidentifier() and text not in _CALLED else "")
