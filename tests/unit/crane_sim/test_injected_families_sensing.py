"""The further laws of sensors and of the flow by their formulas; flaws that every machine has."""

import numpy as np
import pytest
from unit.crane_sim.injected_machine import effect_of, rig
from unit.crane_sim.test_injected_sensing import TIME, A, B, fault, shown, spool

from crane_model import Machine
from crane_sim import SimulatedCrane
from crane_sim.effects.flow import leak, softness
from crane_sim.effects.sensing import drawn_flaws
from crane_sim.parts.cylinders import opening

JOINT, COLUMN = "outer_boom", 2


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_averages_are_late_by_the_delay(share: float) -> None:
    """A ramp is shown as it was then, whatever share of it is the window."""
    seen = fault(effect_of("time_skew", JOINT, 0.02, share, form="averaged"))
    ramp = np.tile(5e6 + 1e6 * TIME[:, None], 4)
    late = seen.pressures(TIME, ramp, ramp)[0][:, COLUMN]
    np.testing.assert_allclose(late[50:], 5e6 + 1e6 * (TIME[50:] - 0.02), atol=200.0)


def test_transducers_by_their_formulas() -> None:
    a, b = A[:, COLUMN], B[:, COLUMN]
    lifted, phase = 5e6 * (B[:, 3] / 5e6) ** 2, 2 * np.pi * 3.0 * TIME
    both = 4e4 * (np.sin(phase) + 0.6 * np.sin(2 * phase + 1))
    for effect, form, values, wanted_a, wanted_b in (
        ("pressure_offset", "drifting", (1e5, 0.1), a + 1e5 * (1 + 0.1 * TIME / 60), b),
        ("pressure_offset", "overloaded", (1e5, 1e8), a + 1e5 / (1 + a / 1e8), b),
        ("chamber_gain", "pressed", (0.03, 1.2), a, b + 0.03 * 5e6 * (b / 5e6) ** 1.2),
        ("chamber_gain", "opposed", (0.03, 0.5), 0.985 * a, 1.03 * b),
        ("crosstalk", "of_chamber_a", (0.02,), a + 0.02 * A[:, 3], b),
        ("crosstalk", "shared_ground", (0.02, 2.0), a + 0.02 * lifted, b),
        (
            "transducer_nonlinearity",
            "knee",
            (1e5, 5e6, 2e7),
            a - 1e5 * np.maximum(a - 5e6, 0) / 1.5e7,
            b,
        ),
        ("pressure_ripple", "two_pumps", (4e4, 3.0, 2.0), a + both, b - 0.3 * both),
    ):
        got_a, got_b = shown(effect_of(effect, JOINT, *values, form=form))
        np.testing.assert_allclose(got_a, wanted_a, err_msg=form)
        np.testing.assert_allclose(got_b, wanted_b, err_msg=form)
    ramp = np.tile(np.linspace(0.0, 2e7, len(TIME))[:, np.newaxis], 4)
    cubic = fault(effect_of("transducer_nonlinearity", JOINT, 1e5, 2e7, form="cubic"))
    bent = (cubic.pressures(TIME, ramp, ramp)[0] - ramp)[:, COLUMN]
    assert (bent.max(), bent.min()) == pytest.approx((1e5, -1e5), rel=0.01)  # both ways
    assert bent[[0, -1]] == pytest.approx(0.0, abs=1e-6)


def test_encoders_by_their_formulas() -> None:
    q = np.random.default_rng(3).normal(size=(9, 4))
    own = q[:, COLUMN]
    phase = 8.0 * own + 0.5
    for effect, form, values, wanted in (
        ("encoder_offset", "strained", (0.01, 0.2, 0.5), 0.01 * (1 + 0.2 * np.sin(own + 0.5))),
        ("encoder_offset", "slipped", (0.01, 0.1), 0.01 * (1 + 0.1 * own)),
        ("encoder_eccentricity", "two_lobes", (0.01, 8.0, 0.5, 0.3),
         0.01 * (np.sin(phase) + 0.3 * np.sin(2 * phase))),
        ("encoder_eccentricity", "graduation", (0.01, 8.0, 0.5),
         0.01 * np.arctan2(np.sin(phase), 1.5 + np.cos(phase))),
    ):  # fmt: skip
        got = fault(effect_of(effect, JOINT, *values, form=form)).positions(q) - q
        np.testing.assert_allclose(got, wanted[:, None] * (np.arange(4) == COLUMN), atol=1e-12)


def test_the_pulsation_of_every_machine_is_below_the_noise_and_aliased(machine: Machine) -> None:
    """Sampled every 5 ms it is where nobody put it; encoder disks err by a few counts."""
    flaws, still = drawn_flaws(machine, 3), np.full((len(TIME), 4), 5e6)
    pulsation = flaws[-1]
    (a, b), rate = pulsation.pressures(TIME, still, still), pulsation.values[0]
    assert rate > 100.0  # beyond what 200 Hz can show
    for shown_as in (a, b):
        size = np.std(shown_as[:, 1:], axis=0)
        assert (size > 5e2).all() and (size < 1e4).all()
    q = np.random.default_rng(3).normal(size=(50, 4))
    error = sum(flaw.positions(q) - q for flaw in flaws[:-1])
    assert 4e-5 < np.abs(error).max() < 2.1e-4
    assert (error[:, [0, 3]] == 0.0).all()


def test_valves_leaks_and_walls(machine: Machine, simulated: SimulatedCrane) -> None:
    zone = simulated.valves[JOINT].dead_band
    x = opening(0.5, zone)
    for effect, form, values, wanted in (
        ("valve_dead_band", "hard_overlap", (0.1,), x - 0.1),
        ("valve_dead_band", "uneven_overlap", (0.1, 0.4), x - 0.14),
        ("valve_asymmetry", "one_way", (0.2,), 1.4 * x),
        ("valve_asymmetry", "gradual", (0.2, 0.01), x * (1 + 0.2 * x / (x + 0.01))),
        ("valve_hysteresis", "two_plays", (0.06, 0.5), opening(0.5 - 0.03 * 0.75, zone)),
    ):
        got = spool(rig(simulated, machine, effect_of(effect, JOINT, *values, form=form)), 0.5)
        assert got == pytest.approx(wanted), form
    creeping = effect_of("valve_hysteresis", JOINT, 0.06, 1e-3, form="creeping_play")
    play = rig(simulated, machine, creeping)
    opened = [spool(play, 0.5) for _ in range(5000)]
    assert opened[0] == pytest.approx(opening(0.47, zone), abs=1e-3)
    assert opened[-1] == pytest.approx(x, abs=1e-3)  # it gets there by and by

    own = simulated.cylinders[JOINT].leakage
    for form, shape, wanted in (
        ("widening", 1e7, 1e-11 * (1 + 1e6 / 1e7)),  # 5 and 4 MPa
        ("worn", 2.0, 1e-11 * (1 + 2 * np.exp(-4 * ((-1.5 + 1.4) / 1.3) ** 2))),
    ):
        injected = rig(
            simulated, machine, effect_of("internal_leakage", JOINT, 1e-11, shape, form=form)
        )
        got = leak(injected.injected, injected.constants, injected.state, COLUMN)
        assert got - own == pytest.approx(wanted), form
    for form, wanted in (("braid", np.exp(-0.15)), ("long_hose", 1 / np.sqrt(1.15))):
        wall = rig(simulated, machine, effect_of("oil_compressibility", JOINT, 0.8, 2e7, form=form))
        got = softness(wall.injected, wall.constants, COLUMN, 3e6)
        assert got == pytest.approx(1 + 0.8 * wanted), form
