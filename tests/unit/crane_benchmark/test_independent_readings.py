"""Faults of sensors of the other make, by what they promise."""

import numpy as np
import pytest

from crane_benchmark.cases.motions import LABORATORY_CRANE
from crane_benchmark.independent.readings import FAMILIES
from crane_sim.effects.form import Form, SensorFault

JOINT, COLUMN = "outer_boom", 2
TIME = np.sort(0.005 * np.arange(800) + np.random.default_rng(1).uniform(-1e-4, 1e-4, 800))
A, B = (
    mean + 5e5 * np.sin(TIME[:, None] * np.arange(1.0, 5.0) + shift)
    for mean, shift in ((6e6, 0.0), (4e6, 1.0))
)
FAULTS = [form for forms in FAMILIES.values() for form in forms if not isinstance(form.law, int)]


def made(form: Form, magnitude: float, share: float = 0.5) -> SensorFault:
    """The fault with its shape so far between its bounds."""
    drawn = [draw.lowest + share * (draw.highest - draw.lowest) for draw in form.draws]
    assert not isinstance(form.law, int)
    return form.law(LABORATORY_CRANE, JOINT, (magnitude, *drawn))


@pytest.mark.parametrize("form", FAULTS, ids=lambda form: f"{form.effect}-{form.name}")
def test_a_fault_shows_on_its_joint_alone_and_the_more_the_larger_it_is(form: Form) -> None:
    q, kept = np.random.default_rng(2).normal(size=(800, 4)), A.copy()
    sizes = []
    for magnitude in (form.magnitude.start, 2.0 * form.magnitude.start):
        fault = made(form, magnitude)
        shown = (fault.positions(q), *fault.pressures(TIME, A, B))
        changed = [reading - true for reading, true in zip(shown, (q, A, B), strict=True)]
        for part in changed:
            assert np.abs(np.delete(part, COLUMN, axis=1)).max() == 0.0
        sizes.append([np.abs(part).max() for part in changed])
    np.testing.assert_array_equal(A, kept)  # what is true stays
    once, twice = np.array(sizes)
    acts = once > 0.0
    assert acts.any()
    assert (twice[acts] > 1.2 * once[acts]).all()


@pytest.mark.parametrize("form", FAMILIES["time_skew"], ids=lambda form: form.name)
def test_a_ramp_is_late_by_the_delay(form: Form) -> None:
    """Once it has gone on for a while; what wanders by the mean of it."""
    ramp = np.tile(5e6 + 1e6 * TIME[:, None], 4)
    shown = made(form, 0.02).pressures(TIME, ramp, ramp)[1][:, COLUMN]
    late = TIME - (shown - 5e6) / 1e6
    lowest, highest = (0.7, 1.3) if form.name == "wandering" else (0.97, 1.03)
    assert 0.02 * lowest <= late[200:].min() and late[200:].max() <= 0.02 * highest


def test_gains_of_a_chamber_are_gains_at_its_pressures() -> None:
    for form in FAMILIES["chamber_gain"]:
        shown = made(form, 0.1, share=0.0).pressures(TIME, A, B)[0]
        ratio = shown[:, COLUMN] / A[:, COLUMN] - 1.0
        assert ratio.min() > 0.07 and ratio.max() < 0.1001, form.name
