"""The identified simulation of a crane moves as the crane does of which it is made."""

from dataclasses import replace

import numpy as np
import pytest
from known_crane import known_model

from crane_model import ConfigurationError, RangeError, load_machine
from crane_model.hydraulics.simulation import MAX_CYCLE_S, IdentifiedSimulation
from crane_model.machine_files import machine_file
from crane_sim import Plant, load_simulated_crane
from crane_sim.plant.closed_loop import IdentifiedPlant

MACHINES = ("laboratory_crane", "excavator", "single_axis")


def swing(name: str, seconds: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, j) of the crane and of its identified simulation under the same commands."""
    machine = load_machine(name)
    simulated = load_simulated_crane(machine_file("simulated_crane.yaml", name), machine)
    start = np.array(simulated.start)
    both = Plant(simulated, machine, start), IdentifiedPlant(known_model(name), machine, start)
    signs = np.where(np.arange(len(start)) % 2, -1.0, 1.0)
    moving = ~np.isin(machine.joint_names, both[1].standing)
    paths: list[list[np.ndarray]] = [[], []]
    for k in range(round(seconds / MAX_CYCLE_S)):
        u = 0.25 * np.sin(2.0 * np.pi * k * MAX_CYCLE_S / seconds) * signs * moving
        for one, path in zip(both, paths, strict=True):
            one.advance(u, MAX_CYCLE_S)
            path.append(one.q)
    return np.array(paths[0]), np.array(paths[1])


@pytest.mark.parametrize("name", MACHINES)
def test_moves_as_its_crane(name: str) -> None:
    crane, simulation = swing(name)
    way = np.ptp(crane, axis=0)
    assert (way > 0.02).sum() >= len(way) - 1
    assert (np.abs(simulation - crane).max(axis=0) <= 0.03 * way + 1e-4).all()


def crane(
    position: np.ndarray | None = None, late: np.ndarray | None = None
) -> IdentifiedSimulation:
    model = known_model()
    start = load_simulated_crane().start
    rest = np.array([[start[load_machine().index(joint)] for joint in model.joints]])
    return IdentifiedSimulation(model, rest if position is None else position, late)


def test_stands_still_with_closed_valves_and_stops_at_its_limits() -> None:
    one = crane()
    before = one.position
    one.advance(np.zeros((1, 3)), 0.5)
    np.testing.assert_allclose(one.position, before, atol=2e-4)
    one.advance(np.ones((1, 3)), 5.0)
    limits = [load_machine().limits[joint] for joint in one.joints]
    np.testing.assert_allclose(one.position[0], [each.position_max for each in limits])
    assert not one.velocity.any()


def test_commands_come_as_late_as_told() -> None:
    late = np.array([0.0, 0.05])
    rest = crane().position
    one = crane(np.tile(rest, (2, 1)), late)
    paths = []
    for _ in range(40):
        one.advance(np.full((2, 3), 0.3), MAX_CYCLE_S)
        paths.append(one.position)
    path = np.array(paths)
    np.testing.assert_allclose(path[10:, 1], path[:-10, 0], atol=1e-4)
    assert np.ptp(path[:, 0], axis=0).min() > 0.005


def test_what_cannot_be_is_said() -> None:
    model = known_model()
    with pytest.raises(RangeError, match="the crane cannot start at 5"):
        crane(np.array([[5.0, -1.5, 0.4]]))
    with pytest.raises(RangeError, match="must be finite"):
        crane().advance(np.full((1, 3), np.nan), MAX_CYCLE_S)
    with pytest.raises(ConfigurationError, match="holds no hydraulics"):
        IdentifiedSimulation(replace(model, hydraulics=None), crane().position)
    with pytest.raises(ConfigurationError, match="was not identified with the machine"):
        IdentifiedPlant(model, load_machine("excavator"), np.zeros(4))
