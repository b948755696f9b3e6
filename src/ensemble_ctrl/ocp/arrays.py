"""The array operations of a system, on CasADi expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca


class CasadiArrays:
    """What `ensemble_ctrl.systems.Arrays` asks for."""

    @staticmethod
    def sin(x: Any) -> Any:
        return ca.sin(x)

    @staticmethod
    def cos(x: Any) -> Any:
        return ca.cos(x)

    @staticmethod
    def tan(x: Any) -> Any:
        return ca.tan(x)

    @staticmethod
    def where(condition: Any, yes: Any, no: Any) -> Any:
        return ca.if_else(condition, yes, no)
