"""All forms of all effects that can be hidden."""

from itertools import groupby

from crane_sim.effects import bending, flow, friction, loads, memory, pushes, sensing
from crane_sim.effects.form import Form

_ALL = (
    *friction.FORMS,
    *pushes.FORMS,
    *memory.FORMS,
    *bending.FORMS,
    *loads.FORMS,
    *sensing.FORMS,
    *flow.FORMS,
)

FORMS: dict[str, tuple[Form, ...]] = {
    effect: tuple(forms) for effect, forms in groupby(_ALL, key=lambda form: form.effect)
}
"""Effect to its forms, the first of which is the default."""
