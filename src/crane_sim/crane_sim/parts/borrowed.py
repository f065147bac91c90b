"""Arrays that compiled code borrows from its caller, who keeps them alive.

Whoever is passed an array in compiled code counts one more reference to it, atomically: of tuples
of dozens of arrays that costs more than most of what a step of a plant works out.
"""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar, cast

from numba import types
from numba.extending import intrinsic

Held = TypeVar("Held")


class Borrow(Protocol):
    """Function that compiled code calls."""

    def __call__(self, held: Held, /) -> Held:
        """`held`, arrays or tuples of them as deep as you like, without a count of references.

        What is made of it must not outlive the call that was passed `held`.
        """


def _borrowed(_typing: object, held: Any) -> tuple[Any, Callable[..., Any]]:
    def generate(context: Any, builder: Any, _signature: object, arguments: Any) -> Any:
        return _uncounted(context, builder, held, arguments[0])

    return held(held), generate


def _uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The value, of a numba type `kind`, with no owner that would be counted."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = array.meminfo.type(None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(cast(Any, kind)):
            inner = _uncounted(context, builder, part, builder.extract_value(value, i))
            value = builder.insert_value(value, inner, i)
    return value


borrowed = cast(Borrow, intrinsic(_borrowed))
