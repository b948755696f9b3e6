"""Numbers of any kind on which a smooth right-hand side can be evaluated."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ensemble_ctrl.certificate.errors import NotSmooth, Unenclosed

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


UFUNCS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: b + a if isinstance(b, Smooth) else a + b,
    "subtract": lambda a, b: (-b) + a if isinstance(b, Smooth) else a - b,
    "multiply": lambda a, b: b * a if isinstance(b, Smooth) else a * b,
    "divide": lambda a, b: b.reciprocal() * a if isinstance(b, Smooth) else a / b,
    "power": lambda a, b: a**b if isinstance(a, Smooth) else b.__rpow__(a),
    "negative": lambda a: -a,
    "positive": lambda a: a,
    "square": lambda a: a * a,
    "reciprocal": lambda a: a.reciprocal(),
    "absolute": abs,
    **{name: (lambda a, name=name: getattr(a, name)()) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")},
    **{name: (lambda a, name=name: getattr(a, name)()) for name in ("tanh", "arctan")},
}
"""What models do for NumPy's functions, by their names."""


class Smooth(ABC):
    """What numbers that stand for smooth functions share: derived operators, and refusals of what is not smooth."""

    @abstractmethod
    def __neg__(self) -> Any: ...

    @abstractmethod
    def __add__(self, other: Any) -> Any: ...

    @abstractmethod
    def __mul__(self, other: Any) -> Any: ...

    @abstractmethod
    def __truediv__(self, other: Any) -> Any: ...

    @abstractmethod
    def _constant(self, value: float) -> Any:
        """A number as one of these."""

    @abstractmethod
    def sin(self) -> Any:
        """Sine."""

    @abstractmethod
    def cos(self) -> Any:
        """Cosine."""

    @abstractmethod
    def exp(self) -> Any:
        """Exponential."""

    @abstractmethod
    def log(self) -> Any:
        """Natural logarithm."""

    @abstractmethod
    def sqrt(self) -> Any:
        """Square root."""

    @abstractmethod
    def arctan(self) -> Any:
        """Arc tangent."""

    @abstractmethod
    def tanh(self) -> Any:
        """Hyperbolic tangent."""

    @abstractmethod
    def reciprocal(self) -> Any:
        """One over it."""

    def __pos__(self) -> Any:
        return self

    def __radd__(self, other: Any) -> Any:
        return self + other

    def __sub__(self, other: Any) -> Any:
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return (-self) + other

    def __rmul__(self, other: Any) -> Any:
        return self * other

    def __rtruediv__(self, other: Any) -> Any:
        return self.reciprocal() * other

    def __pow__(self, power: Any) -> Any:
        # x^y = exp(y log x); x^-n = 1 / x^n; x^(n/2) = sqrt(x)^n
        if isinstance(power, Smooth):
            return (self.log() * power).exp()
        if power < 0:
            return (self ** (-power)).reciprocal()
        if power == int(power):
            return self._whole_power(int(power))
        if 2 * power == int(2 * power):
            return self.sqrt()._whole_power(int(2 * power))
        return (self.log() * float(power)).exp()

    def __rpow__(self, base: Any) -> Any:
        return (self * self._constant(float(base)).log()).exp()

    def _whole_power(self, power: int) -> Any:
        """Square and multiply."""
        if power == 0:
            return self * 0.0 + 1.0
        # x^n = (x^(n // 2))^2, times x for odd n
        half = self._whole_power(power // 2) if power > 1 else None
        square = self if half is None else half * half
        return square if half is None or power % 2 == 0 else square * self

    def tan(self) -> Any:
        """Tangent, where the cosine does not vanish."""
        return self.sin() / self.cos()

    def _refuse(self, *_: Any) -> Any:
        """Comparisons, rounding and truth values of states have no derivative."""
        self._require(np.zeros(1, dtype=bool), "the right-hand side compares or rounds a state", NotSmooth)

    def _require(self, good: Bools, message: str, kind: type[Unenclosed] = Unenclosed) -> None:
        """Refuse unless all pieces are good; the refusal knows the first that is not."""
        if not good.all():
            piece = int(np.flatnonzero(~good)[0])
            raise kind(message, piece, self._uses(piece))

    def _uses(self, piece: int) -> tuple[int, ...]:
        """The states on which this depends on a piece, where that is known."""
        return ()

    __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _refuse
    __bool__ = __float__ = __int__ = __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __round__ = _refuse
    __hash__ = None  # type: ignore[assignment]

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's functions and operators, on numbers and models mixed."""
        if method == "__call__" and any(isinstance(value, np.ndarray) and value.dtype == object for value in inputs):
            return ufunc(*map(_boxed, inputs), **options)
        action = UFUNCS.get(ufunc.__name__)
        if method != "__call__" or action is None or options:
            never = np.zeros(1, dtype=bool)
            self._require(never, f"the right-hand side applies numpy.{ufunc.__name__} to a state", NotSmooth)
            return NotImplemented
        return action(*(value.item() if isinstance(value, np.generic) else value for value in inputs))


def _boxed(value: Any) -> Any:
    """A model as an array of no dimensions, which NumPy combines with arrays of models entry by entry."""
    if not isinstance(value, Smooth):
        return value
    box = np.empty((), dtype=object)
    box[()] = value
    return box
