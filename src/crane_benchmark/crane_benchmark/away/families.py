"""All laws of all effects that a machine of the other make can hide: three of each effect."""

from itertools import groupby

from crane_benchmark.away import pushing, rubbing, zeros
from crane_sim.effects.form import Form

FAMILIES: dict[str, tuple[Form, ...]] = {
    effect: tuple(forms)
    for effect, forms in groupby(
        (*rubbing.FORMS, *pushing.FORMS, *zeros.FORMS), key=lambda form: form.effect
    )
}
"""Effect to its laws; ten effects are of the catalogue, two of none."""
