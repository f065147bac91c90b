"""A boom that bends, against the equations of motion of a mass on a spring, by other code."""

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from scipy.integrate import solve_ivp
from unit.crane_model.test_term_registry import SETTING

from crane_model import Machine, Record
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.terms import Setting, term_from_mapping
from crane_model.terms.elasticity import BoomFlexibility
from crane_model.terms.gravity_and_load import tip_mass

STEP, COUNT = 0.002, 1000  # s
START = np.array([0.3, -1.2, 0.7])
REACH, RATE = np.array([0.08, 0.12, 0.1]), np.array([5.0, 7.0, 6.0])


def motion(time: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, q', q'' (n, 3), from rest."""
    phase = np.multiply.outer(time, RATE)
    return (
        START + REACH * (1.0 - np.cos(phase)),
        REACH * RATE * np.sin(phase),
        REACH * RATE**2 * np.cos(phase),
    )


def weighed(machine: Machine, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Forces (3,) that a mass of 1 kg at the boom tip asks of the planar joints, by (8)."""
    regressor = lagrangian_regressor(Geometry.of(machine), *(one[None] for one in (q, v, a)))
    return (regressor @ tip_mass(machine))[0]


@pytest.mark.parametrize(
    ("joint", "frequency"), [("inner_boom", 0.9), ("outer_boom", 3.0), ("telescope", 12.0)]
)
def test_bending_is_that_of_a_mass_on_a_spring(
    machine: Machine, joint: str, frequency: float
) -> None:
    """Integrated to eight digits: forces on every joint, from the sag at the start on."""
    damping, i = 0.06, PLANAR_JOINTS.index(joint)
    unit, still = np.eye(3)[i], np.zeros(3)
    rows = [machine.limits[name] for name in PLANAR_JOINTS]
    middle = np.array([(row.position_min + row.position_max) / 2.0 for row in rows])

    def inertia(q: np.ndarray) -> float:
        return float((weighed(machine, q, still, unit) - weighed(machine, q, still, still))[i])

    omega = 2.0 * np.pi * frequency
    stiffness, damper = inertia(middle) * omega**2, 2.0 * damping * inertia(middle) * omega

    def swing(time: float, e: float, rate: float) -> float:
        q, v, a = motion(time)
        carried = weighed(machine, q + e * unit, v + rate * unit, a)[i]
        return -(stiffness * e + damper * rate + carried) / inertia(q + e * unit)

    sag = 0.0
    for _ in range(60):
        sag = -weighed(machine, START + sag * unit, still, still)[i] / stiffness
    time = STEP * np.arange(COUNT)
    exact = solve_ivp(
        lambda t, y: [y[1], swing(t, *y)], (0.0, time[-1]), [sag, 0.0], "DOP853", time[::50],
        rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    expected = [
        weighed(machine, q + e * unit, v + rate * unit, a + swing(t, e, rate) * unit)
        - weighed(machine, q, v, a)
        for t, (e, rate), q, v, a in zip(exact.t, exact.y.T, *motion(exact.t), strict=True)
    ]
    term = BoomFlexibility(joint=joint, frequency=frequency, damping=damping)
    record = Record(PLANAR_JOINTS, time, *motion(time))
    got = inertia(middle) * term.columns(record, SETTING)[::50, :, 0]
    size = np.abs(expected).max(axis=0)
    assert (size > 1e-3).all()  # on every joint
    np.testing.assert_allclose(got / size, expected / size, atol=0.03)


def test_without_the_plane_it_is_an_oscillator_on_its_own_joint() -> None:
    """One boom alone, and one axis without a machine: nothing is known of weight or neighbours."""
    time = STEP * np.arange(COUNT)
    alone = Record(("inner_boom",), time, *(one[:, :1] for one in motion(time)))
    term = BoomFlexibility(joint="inner_boom", frequency=3.0, damping=0.3)
    of_boom, of_axis = (
        term.columns(alone, Setting({"inner_boom": "rad"}, machine))
        for machine in (SETTING.machine, None)
    )
    np.testing.assert_array_equal(of_boom, of_axis)
    omega, forced = 6.0 * np.pi, RATE[0]
    ratio = forced / omega
    gain = ratio**2 / np.hypot(1.0 - ratio**2, 0.6 * ratio)
    late = of_axis[time > time[-1] - 2.0 * np.pi / forced, 0, 0]
    assert np.abs(late).max() == pytest.approx(gain * REACH[0] * forced**2, rel=0.1)


def test_a_model_file_of_before_is_read() -> None:
    """Its fields and the name and unit of its parameter are what they were."""
    entry = {"type": "boom_flexibility", "joint": "outer_boom", "frequency": 2.0, "damping": 0.1}
    (parameter,) = term_from_mapping(entry).parameters(SETTING)
    assert (parameter.name, parameter.unit) == ("J_flexible.outer_boom", "kg m2")
