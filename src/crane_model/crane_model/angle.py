"""Angles in files: numbers in rad, or sums and products with pi, as `pi/2 - 0.1192`."""

import ast
import math
import operator
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator

WIDEST = 4.0 * math.pi  # rad, of a direction: two turns
_OPERATIONS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def _read(given: Any) -> Any:
    if not isinstance(given, str):
        return given
    try:
        return _value(ast.parse(given.strip(), mode="eval").body)
    except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError):
        raise ValueError(
            f"must be an angle in rad, a number or like pi/2 - 0.1, got {given!r}"
        ) from None


def _value(node: ast.expr) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="pi"):
            return math.pi
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand)
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATIONS:
            return _OPERATIONS[type(sign)](_value(left), _value(right))
    raise ValueError


def _within(angle: float) -> float:
    if abs(angle) > WIDEST:
        raise ValueError(
            f"must be an angle in rad, within {WIDEST:.3g} either way, got {angle:g}; is it in "
            "degrees?"
        )
    return angle


Angle = Annotated[float, BeforeValidator(_read)]
Direction = Annotated[Angle, AfterValidator(_within)]
"""An angle of the geometry, which is no joint's coordinate."""
