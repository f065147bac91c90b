"""The plant as a whole."""

import numpy as np
import pytest

from crane_model import Machine, RangeError
from crane_sim import Plant, SimulatedCrane
from crane_sim.parts.constants import pack
from crane_sim.parts.parameters import column
from crane_sim.parts.rigid_bodies import mass_and_bias


@pytest.fixture
def plant(machine: Machine, simulated: SimulatedCrane) -> Plant:
    """At rest."""
    return Plant(simulated, machine, simulated.start)


def test_a_crane_at_rest_stays_at_rest(plant: Plant, simulated: SimulatedCrane) -> None:
    """Closed valves: exactly still until leakage past the pistons has changed the load so far that
    it exceeds breakaway; then the joints creep, by less than 2 mm or mrad in ten seconds.
    """
    plant.advance(np.zeros(4), 2.0)
    assert (plant.q == simulated.start).all()
    plant.advance(np.zeros(4), 8.0)
    assert np.abs(plant.q - simulated.start).max() < 2e-3


@pytest.mark.parametrize("joint", range(4))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_positive_command_moves_the_joint_in_its_positive_direction(
    plant: Plant, joint: int, sign: float
) -> None:
    """Whatever the sign of the lever arm; the other joints hardly move."""
    command = np.zeros(4)
    command[joint] = 0.3 * sign
    start = plant.q
    plant.advance(command, 1.0)
    moved = plant.q - start
    assert sign * moved[joint] > 0.02
    assert np.abs(np.delete(moved, joint)).max() < 0.02


def test_commands_inside_the_dead_band_do_nothing(plant: Plant, simulated: SimulatedCrane) -> None:
    """0.8 of every dead band for two seconds."""
    plant.advance(0.8 * column(simulated.valves, "dead_band"), 2.0)
    assert (plant.q == simulated.start).all()


def test_end_stop_holds_against_a_full_command(
    plant: Plant, machine: Machine, simulated: SimulatedCrane
) -> None:
    """The telescope runs out and stays, pressed into the stop by what the supply can push."""
    command = np.array([0.0, 0.0, 0.0, 1.0])
    cylinder, stop = machine.cylinders["telescope"], simulated.cylinders["telescope"]
    pressed = machine.hydraulics.supply_pressure * cylinder.area_a / stop.stop_stiffness
    plant.advance(command, 8.0)
    for _ in range(2):
        assert 0.0 < plant.q[3] - cylinder.length_max < 1.2 * pressed
        assert abs(plant.v[3]) < 1e-3
        plant.advance(command, 1.0)


def test_all_cylinders_at_once_ask_more_than_the_pump_gives(plant: Plant, machine: Machine) -> None:
    """The supply pressure sags, and recovers when the valves close."""
    plant.advance(np.array([1.0, 1.0, -1.0, 1.0]), 0.5)
    assert plant.supply_pressure < 0.9 * machine.hydraulics.supply_pressure
    plant.advance(np.zeros(4), 2.0)
    assert plant.supply_pressure > 0.95 * machine.hydraulics.supply_pressure


def test_halving_the_step_changes_little(machine: Machine, simulated: SimulatedCrane) -> None:
    """The step is short enough: positions after a second of motion agree to a tenth of a mm."""
    ends = []
    for step in (simulated.step, simulated.step / 4):
        plant = Plant(simulated.model_copy(update={"step": step}), machine, simulated.start)
        plant.advance(np.array([0.0, 0.3, 0.3, 0.3]), 1.0)
        ends.append(plant.q)
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-4)


def test_bodies_alone_conserve_energy(machine: Machine, simulated: SimulatedCrane) -> None:
    """dE/dt = 0 without forces: v . (M a + bias) with E from M and the potential energy's slope."""
    chain = pack(simulated, machine).chain
    rng = np.random.default_rng(5)

    def terms(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mass, bias = np.empty((4, 4)), np.empty(4)
        mass_and_bias(chain, q, v, mass, bias)
        return mass, bias

    for _ in range(50):
        q = rng.uniform([-2, -0.45, -2.7, 0], [2, 1.37, -0.1, 1.55])
        v = rng.normal(size=4)
        mass, bias = terms(q, v)
        assert np.linalg.eigvalsh(mass).min() > 0.0
        gravity = terms(q, np.zeros(4))[1]
        acceleration = np.linalg.solve(mass, -bias)
        step = 1e-6
        slope = (terms(q + step * v, v)[0] - terms(q - step * v, v)[0]) / (2 * step)
        power = v @ mass @ acceleration + 0.5 * v @ slope @ v + v @ gravity
        assert power == pytest.approx(0.0, abs=1e-4 * np.abs(bias).max())


def test_bad_commands_and_poses_are_refused_by_name(
    plant: Plant, machine: Machine, simulated: SimulatedCrane
) -> None:
    """Nothing moves."""
    with pytest.raises(RangeError, match="valve command"):
        plant.advance(np.array([0.0, np.nan, 0.0, 0.0]), 0.01)
    assert plant.time == 0.0
    outside = simulated.start.copy()
    outside[machine.index("inner_boom")] = 2.0
    with pytest.raises(RangeError, match=r"inner_boom.*2 rad.*1\.37"):
        Plant(simulated, machine, outside)
