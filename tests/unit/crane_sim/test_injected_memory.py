"""Injected effects with a memory: hysteresis, play, a swinging load."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from unit.crane_sim.injected_machine import STEP, Rig, effect_of, rig

from crane_model import Machine
from crane_sim import SimulatedCrane
from crane_sim.effects.form import InjectedForm

JOINT, COLUMN = "telescope", 3
TRAVEL, SHARE = 4e-3, 0.6
PRESLIDING = [
    effect_of("presliding", JOINT, TRAVEL, SHARE, 3e-3),
    effect_of("presliding", JOINT, TRAVEL, SHARE, 2.0, form="bouc_wen"),
    effect_of("maxwell_slip", JOINT, TRAVEL, SHARE),
]


def led(machine_rig: Rig, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Resistance (n,) and noted force (n,) of one effect along positions (n,) of its joint."""
    q, speeds = np.array([0.0, 0.3, -1.4, 0.5]), np.diff(path, prepend=path[:1]) / STEP
    resistance, noted = np.empty((2, len(path)))
    for n, (place, speed) in enumerate(zip(path, speeds, strict=True)):
        q[COLUMN] = place
        machine_rig.put(q, np.array([0.0, 0.0, 0.0, speed]))
        machine_rig.act()
        resistance[n] = -machine_rig.scratch.force[COLUMN]
        noted[n] = machine_rig.settle()[0, COLUMN]
    return resistance, noted


def line(*corners: float, speed: float = 0.05) -> np.ndarray:
    """Positions from corner to corner, evenly."""
    parts = [
        np.linspace(a, b, max(2, round(abs(b - a) / speed / STEP)), endpoint=False)
        for a, b in pairwise(corners)
    ]
    return np.concatenate(parts)


@pytest.mark.parametrize("effect", PRESLIDING, ids=lambda effect: effect.form.name)
def test_presliding_ends_in_the_coulomb_friction_that_it_replaces(
    machine: Machine, simulated: SimulatedCrane, effect: InjectedForm
) -> None:
    """What is taken from (13) comes back after a few travels, and nothing is noted then."""
    law = simulated.friction[JOINT]
    injected = rig(simulated, machine, effect)
    resistance, noted = led(injected, line(0.5, 0.55))
    up = law.f_c + law.df_c
    assert resistance[-1] == pytest.approx(SHARE * up, rel=1e-3)
    assert noted[-1] == pytest.approx(0.0, abs=1e-3 * up)
    left = injected.scratch.law[COLUMN]["coulomb_up"]
    assert left == pytest.approx((1 - SHARE) * up)
    early = resistance[: round(0.2 * TRAVEL / 0.05 / STEP)]
    assert early[-1] < 0.5 * SHARE * up  # it builds up
    assert noted[1] < -0.5 * SHARE * up  # what (13) would have at once


@pytest.mark.parametrize("effect", PRESLIDING[1:], ids=lambda effect: effect.form.name)
def test_presliding_does_not_depend_on_the_speed(
    machine: Machine, simulated: SimulatedCrane, effect: InjectedForm
) -> None:
    """The same loop at three times the speed."""
    slow, fast = (
        led(rig(simulated, machine, effect), line(0.5, 0.503, 0.501, 0.506, speed=speed))[0]
        for speed in (0.01, 0.03)
    )
    np.testing.assert_allclose(slow[2::3][: len(fast) - 1], fast[: len(fast) - 1], atol=25.0)  # N


def test_slip_blocks_remember_where_they_turned(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """An inner loop closes: back at the point where it left the outer one, the force is as then."""
    path = line(0.5, 0.5025, 0.5015, 0.5025, 0.503, speed=0.01)
    resistance, _ = led(rig(simulated, machine, PRESLIDING[2]), path)
    turned, back = (round(way / 0.01 / STEP) for way in (0.0025, 0.0045))
    assert resistance[back] == pytest.approx(resistance[turned], rel=0.01)


def test_play_shows_only_after_the_load_changed_sides(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """Full force at once, half of it half-way through the clearance, none after."""
    noted = _play(machine, simulated)
    assert noted(300.0, 0.5) == 0.0
    assert noted(300.0, 0.6) == 0.0
    assert noted(4.0, 0.6) == 0.0  # too little to say
    assert noted(-300.0, 0.6) == pytest.approx(80.0)
    assert noted(-300.0, 0.605) == pytest.approx(40.0)
    assert noted(-300.0, 0.6101) == 0.0
    assert noted(-300.0, 0.6) == 0.0  # seated, wherever it goes
    assert noted(300.0, 0.6) == pytest.approx(-80.0)


def test_a_pin_has_no_further_to_go_back_than_it_came(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """A load that turns again after a tenth of the clearance finds it a tenth from its seat."""
    noted = _play(machine, simulated)
    assert noted(300.0, 0.6) == 0.0
    assert noted(-300.0, 0.601) == pytest.approx(80.0, rel=0.03)  # smooth at either end
    assert noted(300.0, 0.601) == pytest.approx(0.0, abs=3.0)
    assert noted(300.0, 0.602) == 0.0
    assert noted(-300.0, 0.602) == pytest.approx(80.0)


def _play(machine: Machine, simulated: SimulatedCrane) -> Callable[[float, float], float]:
    """What the drive lacks under a load where the joint stands, 0.01 m of play having 80 N."""
    injected = rig(simulated, machine, effect_of("backlash", JOINT, 80.0, 0.01, 5.0))
    q = np.array([0.0, 0.3, -1.4, 0.5])

    def noted(load: float, place: float) -> float:
        q[COLUMN] = place
        injected.put(q, np.zeros(4), np.array([0.0, 0.0, 0.0, load]))
        injected.act()
        return float(injected.settle()[0, COLUMN])

    return noted


def test_a_load_swings_with_the_frequency_of_its_length(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """Let go at 0.05 rad over a crane at rest: sqrt(g/l)/2 pi, and damped as it should be."""
    length, damping = 1.2, 0.02
    injected = rig(simulated, machine, effect_of("swinging_load", None, 30.0, length, damping))
    injected.injected.memory[0, 0] = 0.05
    angle = np.empty(round(6.0 / STEP))
    for n in range(len(angle)):
        injected.put(np.array([0.0, 0.3, -1.4, 0.5]), np.zeros(4))
        injected.act()
        injected.settle()
        angle[n] = injected.injected.memory[0, 0]
    falls = np.flatnonzero((angle[:-1] > 0) & (angle[1:] <= 0)) * STEP
    assert np.diff(falls).mean() == pytest.approx(
        2 * np.pi * np.sqrt(length / machine.gravity), rel=2e-3
    )
    peaks = angle[1:-1][(angle[1:-1] > angle[:-2]) & (angle[1:-1] >= angle[2:])]
    ratio = peaks[1] / peaks[0]
    assert np.log(1 / ratio) == pytest.approx(2 * np.pi * damping, rel=0.05)
