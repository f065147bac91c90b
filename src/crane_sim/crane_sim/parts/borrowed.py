"""Arrays that compiled code borrows from its caller, who keeps them alive.

Whoever is passed an array in compiled code counts one more reference to it, atomically: of tuples
of dozens of arrays that costs more than most of what a step of a plant works out.
"""

from collections.abc import Callable

from numba import types
from numba.core.base import BaseContext
from numba.core.typing.context import BaseContext as TypingContext
from numba.core.typing.templates import Signature
from numba.extending import intrinsic


@intrinsic
def borrowed(typing: TypingContext, held: types.Type) -> tuple[Signature, Callable[..., object]]:
    """`held`, arrays or tuples of them as deep as you like, without a count of references.

    What is made of it must not outlive the call that was passed `held`.
    """

    def generate(context: BaseContext, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _uncounted(context, builder, held, arguments[0])

    return held(held), generate


def _uncounted(context: BaseContext, builder, kind: types.Type, value):  # type: ignore[no-untyped-def]
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = array.meminfo.type(None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(kind):
            inner = _uncounted(context, builder, part, builder.extract_value(value, i))
            value = builder.insert_value(value, inner, i)
    return value
