"""What an effect is said to follow is what its force depends on."""

from typing import get_args

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from unit.crane_model.test_term_registry import CANDIDATES, example, setting_of

from crane_model import Record
from crane_model.terms import REGISTRY, MemoryTerm
from crane_model.terms.term import Variable

SAMPLES = 40
BETWEEN = {"recording"}  # differs from one recording to another, not within one
WITHOUT_MEMORY = [
    (name, variable)
    for name in CANDIDATES
    if not issubclass(REGISTRY[name], MemoryTerm)
    for variable in REGISTRY[name].effect.follows  # type: ignore[union-attr]
    if variable not in BETWEEN
]


def record(changing: str = "") -> Record:
    """Everything stays as it is but one variable, whose values differ from sample to sample."""

    def signal(name: str, low: float, high: float, joints: int = 3) -> np.ndarray:
        rows = np.linspace(low, high, SAMPLES) if name == changing else np.full(SAMPLES, high)
        return np.repeat(rows[:, np.newaxis], joints, axis=1)

    q = signal("position", 0.1, 0.3)
    q[:, 1] -= 1.5
    if changing == "extension of the telescope":
        q[:, 2] += np.linspace(0.0, 0.5, SAMPLES)
    if changing == "inclination of the telescope":
        q[:, :2] += np.linspace(0.0, 0.3, SAMPLES)[:, np.newaxis]
    force, rate = signal("force", -900.0, 900.0), signal("rate of the force", -10.0, 10.0)
    sum_of_both = signal("pressure sum", 1e6, 5e6)
    return Record(
        PLANAR_JOINTS,
        100.0 + np.linspace(0.0, 100.0 if changing == "time" else 1e-6, SAMPLES),
        q,
        signal("velocity", -0.1, 0.1),
        signal("acceleration", -0.2, 0.2),
        force=force,
        force_rate=rate,
        force_at=lambda lead: force + lead * rate,
        pressure_a=sum_of_both,
        pressure_b=sum_of_both + signal("pressure of chamber B", 1e6, 5e6),
        slew_velocity=signal("slew velocity", 0.1, 0.3, 1)[:, 0],
        slew_position=np.zeros(SAMPLES),
        slew_acceleration=np.zeros(SAMPLES),
        temperature=signal("temperature", 20.0, 60.0, 1)[:, 0],
    )


def spread(name: str, changing: str = "") -> float:
    """By how much the columns of the term differ between samples, relative to their size."""
    term = example(name)
    if name == "end_cushioning":  # acts near the ends only
        term = type(term).model_validate({**term.model_dump(), "zone": 1.2})
    columns = term.columns(record(changing), setting_of(name))
    return float(np.ptp(columns, axis=0).max() / max(np.abs(columns).max(), 1e-12))


@pytest.mark.parametrize(("name", "variable"), WITHOUT_MEMORY)
def test_the_force_of_an_effect_changes_with_what_it_follows(name: str, variable: str) -> None:
    if variable != "time":
        assert spread(name) < 1e-6
    assert spread(name, variable) > 0.01


@pytest.mark.parametrize("name", CANDIDATES)
def test_effects_follow_something_but_for_constant_forces(name: str) -> None:
    effect = REGISTRY[name].effect
    assert effect is not None
    assert bool(effect.follows) == ("constant force, whatever" not in effect.signature)
    assert set(effect.follows) <= set(get_args(Variable))
