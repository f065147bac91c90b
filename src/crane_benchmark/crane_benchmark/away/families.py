"""All laws of all effects that a machine of the other make can hide: three of each effect."""

from itertools import groupby

from crane_benchmark.away import pushing, readings, rubbing, zeros
from crane_sim.effects.form import Form

_ALL = (*rubbing.FORMS, *pushing.FORMS, *zeros.FORMS, *readings.FORMS)

FAMILIES: dict[str, tuple[Form, ...]] = {
    effect: tuple(forms) for effect, forms in groupby(_ALL, key=lambda form: form.effect)
}
"""Effect to its laws; effects of the catalogue, and some of none."""
