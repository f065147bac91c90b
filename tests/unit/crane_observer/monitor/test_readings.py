"""What single readings tell, of encoders with steps that rest and then move."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_observer import Part, Wrong
from crane_observer.monitor.readings import LOOKED_AT, PINNED, ReadingHabits, ReadingWatch

STEP = 4.8e-5  # rad
PERIOD = 0.005  # s


def course(rest: int, speed: float, moving: int) -> np.ndarray:
    """An encoder that rests, and then moves as smoothly as its steps let it."""
    t = PERIOD * np.arange(rest + moving)
    since = np.clip(t - PERIOD * rest, 0.0, None)
    q = 0.3 + speed * since * since / (since + 0.5)
    return np.asarray(STEP * np.round(q / STEP))


def fed(values: np.ndarray) -> list[bool]:
    habits = ReadingHabits(1)
    told = []
    for value in values:
        habits.add(np.array([value]))
        told.append(bool(habits.noisy[0]))
    return told


@given(rest=st.integers(0, 3000), speed=st.floats(-0.5, 0.5))
def test_steps_of_an_encoder_are_no_noise(rest: int, speed: float) -> None:
    assert not any(fed(course(rest, speed, 600)))


@pytest.mark.parametrize("steps", [8.0, 30.0])
def test_noise_beyond_the_steps_is(steps: float) -> None:
    values = course(1000, 0.1, 1200)
    rng = np.random.default_rng(2)
    noise = steps * STEP * rng.standard_normal(700)
    values[1500:] += STEP * np.round(noise / STEP)
    told = fed(values)
    assert not any(told[:1500])
    assert any(told[1500 : 1500 + LOOKED_AT])


def test_a_reading_that_is_missing_spoils_nothing() -> None:
    habits = ReadingHabits(1)
    rng = np.random.default_rng(3)
    for k, reading in enumerate(1e5 + 1e3 * rng.standard_normal(1000)):
        habits.add(np.array([np.nan if k % 100 == 50 else reading]))
    assert 0.5e3 < habits.noise[0] < 2e3


@pytest.mark.parametrize(
    ("held", "lasting", "stuck"),
    [
        (24e6, LOOKED_AT - 1, False),
        (24e6, LOOKED_AT + 1, True),
        (25e6, LOOKED_AT + 1, False),  # a load that swings: the chamber is beyond what it can show
        (25e6, PINNED + 1, True),
    ],
)
def test_a_transducer_at_its_end_is_stuck_only_if_it_stays(
    held: float, lasting: int, stuck: bool
) -> None:
    watched = ReadingWatch(["boom"], ["rad"], None)
    rng = np.random.default_rng(6)
    shown = 1e7 + 1e4 * rng.standard_normal((1000, 3))
    shown[-1 - lasting :, 1] = held
    for k, (a, b, supply) in enumerate(shown):
        watched.read_pressures(PERIOD * k, np.array([a]), np.array([b]), supply)
    found = watched.found(PERIOD * len(shown))
    assert [(finding.part, finding.kind) for finding in found] == [
        (Part.PRESSURE_B, Wrong.STUCK)
    ] * stuck


@pytest.mark.parametrize(("noise", "stuck"), [(0.2, False), (0.5, True)])
def test_a_reading_that_stands_says_nothing_if_a_step_hides_the_noise(
    noise: float, stuck: bool
) -> None:
    """A pressure that swings, and then rests in the middle of a step; noise in steps."""
    rng, t = np.random.default_rng(5), np.arange(2000)
    swings = np.where(t < 1500, 20.0 * np.sin(0.05 * t), 0.0)
    shown = np.round(swings + noise * rng.standard_normal(len(t)))
    shown[1500:] = 0.0
    habits = ReadingHabits(1)
    told = []
    for value in shown:
        habits.add(np.array([value]))
        told.append(bool(habits.stuck[0]))
    assert any(told) == stuck and not any(told[:1500])


@pytest.mark.parametrize(
    ("machine", "stuck"), [("laboratory_crane", True), ("field_excavator", False)]
)
def test_a_supply_that_follows_the_loads_may_stand(machine: str, stuck: bool) -> None:
    """Loads shake it, and it stands while the machine does."""
    watched = ReadingWatch(["boom"], ["rad"], load_machine(machine_file("machine.yaml", machine)))
    rng = np.random.default_rng(7)
    shown = 1e7 + 5e5 * rng.standard_normal((1000, 3))
    shown[-1 - LOOKED_AT :, 2] = 2e6
    for k, (a, b, supply) in enumerate(shown):
        watched.read_pressures(PERIOD * k, np.array([a]), np.array([b]), supply)
    found = watched.found(PERIOD * len(shown))
    kinds = [(finding.part, finding.kind) for finding in found]
    assert kinds == [(Part.SUPPLY, Wrong.STUCK)] * stuck
