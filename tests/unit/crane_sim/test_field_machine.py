"""What field machines have: dead time, one pump for all, inertial sensors, an operator."""

from pathlib import Path

import numpy as np
import pytest

from crane_bags import read_topics
from crane_bags.types import JOINT_REFERENCE, JOINT_STATES, VALVE_COMMAND
from crane_model import ConfigurationError, Machine
from crane_model.cylinders import lever_arm
from crane_model.machine_files import machine_file
from crane_model.sensors import InertialSensor
from crane_sim import Plant, SimulatedCrane
from crane_sim.make_bag import main
from crane_sim.parts.parameters import load_both
from crane_sim.plant.plant import DeadTime
from crane_sim.plant.sampled import InertialSensors
from crane_sim.work import load_work

NAME, WARM_S = "field_excavator", 1e5
CYCLE_S = 0.02


@pytest.fixture(scope="module")
def field() -> tuple[Machine, SimulatedCrane]:
    return load_both(NAME, None)


@pytest.mark.parametrize("running", [0.0, 600.0, WARM_S])
def test_a_spool_begins_to_move_one_dead_time_after_its_command(
    field: tuple[Machine, SimulatedCrane], running: float
) -> None:
    """That falls exponentially as the machine warms up."""
    machine, simulated = field
    plant = Plant(simulated, machine, simulated.start, running=running)
    moved = np.full(4, np.nan)
    for k in range(600):
        plant.advance(np.full(4, 0.5), 1e-3)
        first = np.isnan(moved) & (plant.spool != 0.0)
        moved[first] = (k + 1) * 1e-3
    valves = simulated.valves.values()
    share = np.exp(-running / simulated.oil.warming)
    expected = [valve.dead_time + share * valve.cold_dead_time for valve in valves]
    np.testing.assert_allclose(moved, expected, atol=1.5e-3)


def test_every_command_is_heard_as_long_as_it_was_given(
    field: tuple[Machine, SimulatedCrane],
) -> None:
    """Whatever the cycles: against the commands as a function of time, shifted."""
    simulated = field[1]
    line = DeadTime(simulated)
    rng = np.random.default_rng(1)
    begin, given, heard = WARM_S, [], []
    for _ in range(100):
        command, duration = rng.uniform(-1.0, 1.0, 4), float(rng.uniform(0.005, 0.06))
        given.append((begin, command))
        at = begin
        for length, commands in line.heard(command, begin, duration):
            heard.append((at, at + length, commands.copy()))
            at += length
        assert at == pytest.approx(begin + duration, abs=1e-9)
        begin += duration
    times = np.array([time for time, _ in given])
    commands = np.array([command for _, command in given])
    dead = line.now(WARM_S)
    for first, last, shown in heard[1:]:
        middle = 0.5 * (first + last)
        for joint in range(4):
            k = int(np.searchsorted(times, middle - dead[joint], side="right")) - 1
            assert shown[joint] == (commands[k, joint] if k >= 0 else 0.0)


def test_a_machine_at_rest_has_no_more_pressure_than_its_load_and_an_idle_pump_leave(
    field: tuple[Machine, SimulatedCrane],
) -> None:
    """And stays where it is."""
    machine, simulated = field
    plant = Plant(simulated, machine, simulated.start, running=WARM_S)
    assert machine.hydraulics.load_sensing is not None
    idle = machine.hydraulics.load_sensing.margin + plant.tank_pressure
    lower = np.minimum(plant.pressure_a, plant.pressure_b)
    assert (lower >= plant.tank_pressure).all() and (lower <= idle).all()
    plant.advance(np.zeros(4), 2.0)
    np.testing.assert_allclose(plant.q, simulated.start, atol=1e-4)


def steady_flows(plant: Plant, command: np.ndarray, seconds: float) -> np.ndarray:
    """(j,) mean flow into the chambers that are fed, over the last half [m3/s]."""
    flows = []
    for _ in range(round(seconds / CYCLE_S)):
        plant.advance(command, CYCLE_S)
        lever = np.array(
            [
                lever_arm(plant.machine, joint, plant.q[i : i + 1])[0]
                for i, joint in enumerate(plant.machine.joint_names)
            ]
        )
        speed = lever * plant.v
        cylinders = [plant.machine.cylinders[joint] for joint in plant.machine.joint_names]
        areas = [
            cylinder.area_a if rate > 0 else cylinder.area_b
            for cylinder, rate in zip(cylinders, speed, strict=True)
        ]
        flows.append(np.abs(speed) * areas)
    found: np.ndarray = np.mean(flows[-len(flows) // 2 :], axis=0)
    return found


def test_the_pump_gives_no_more_than_flow_and_power_and_shares_it(
    field: tuple[Machine, SimulatedCrane],
) -> None:
    """Boom and arm lift at once: each gets what its valve meters at the margin, and from a small
    pump all that there is, in the same ratio.
    """
    machine, simulated = field
    small = machine.model_copy(
        update={"supply": machine.hydraulics.model_copy(update={"pump_flow": 3.0e-3})}
    )
    command = np.array([0.0, 0.5, 0.8, 0.0])
    rich, poor = (
        Plant(simulated, each, simulated.start, running=WARM_S) for each in (machine, small)
    )
    boom, arm = simulated.valves["boom"], simulated.valves["arm"]
    metered = np.array(
        [
            boom.rated_flow * (0.5 - boom.dead_band) / (1.0 - boom.dead_band),
            arm.rated_flow * arm.edges.supply_b * (0.8 - arm.dead_band) / (1.0 - arm.dead_band),
        ]
    )
    enough, short = (steady_flows(plant, command, 2.4)[1:3] for plant in (rich, poor))
    load = max(rich.pressure_a[1], rich.pressure_b[2])
    drop = (rich.supply_pressure - load) / simulated.valves["boom"].rated_drop
    assert 0.6 < drop < 1.3  # the pump droops, too
    np.testing.assert_allclose(
        enough, metered * drop**0.5, rtol=0.2
    )  # as do compensators, and the boom swings
    assert short.sum() == pytest.approx(3.0e-3, rel=0.06)
    assert short[0] / short[1] == pytest.approx(metered[0] / metered[1], rel=0.1)
    assert poor.supply_pressure - max(poor.pressure_a[1], poor.pressure_b[2]) < 1.5e6


def test_the_supply_keeps_its_margin_above_the_highest_load(
    field: tuple[Machine, SimulatedCrane],
) -> None:
    machine, simulated = field
    sensing = machine.hydraulics.load_sensing
    assert sensing is not None
    plant = Plant(simulated, machine, simulated.start, running=WARM_S)
    steady_flows(plant, np.array([0.0, 0.3, 0.0, 0.0]), 2.0)
    assert plant.supply_pressure - plant.pressure_a[1] == pytest.approx(sensing.margin, rel=0.3)
    steady_flows(plant, np.zeros(4), 2.0)
    assert plant.supply_pressure < 2.5 * sensing.margin  # nobody asks: it is unloaded


def test_inertial_sensors_are_late_biased_and_noisy(
    field: tuple[Machine, SimulatedCrane],
) -> None:
    """A joint that turns at constant speed shows where it was, and the biases of two links."""
    machine, simulated = field
    sensor = InertialSensor(bias=0.01, noise=1e-3, latency=0.05, vibration=0.0, frequency=10.0)
    other = sensor.model_copy(update={"bias": -0.02})
    chain = simulated.sensors.model_copy(update={"inertial": {"boom": sensor, "arm": other}})
    shown, speed = InertialSensors(chain, machine, 1), np.array([0.3, 0.2, -0.1, 0.4])
    times = CYCLE_S * np.arange(3000)
    read = np.array([shown.shown(speed * time, time) for time in times])[10:]
    error = read - times[10:, np.newaxis] * speed
    late = -0.05 * speed
    np.testing.assert_allclose(
        error.mean(axis=0), [0.0, late[1] + 0.01, late[2] - 0.03, 0.0], atol=1e-4
    )
    np.testing.assert_allclose(error.std(axis=0), [0.0, 1e-3, 2**0.5 * 1e-3, 0.0], rtol=0.05)
    noise = chain.equivalent_counts(machine.joint_names) / np.sqrt(12.0)
    assert noise[2] == pytest.approx(np.sqrt(2e-6 + chain.encoder_resolution["arm"] ** 2 / 12))


def test_an_operator_moves_every_joint_and_leaves_no_reference(tmp_path: Path) -> None:
    """By levers, several at a time, from pose to pose; the same seed works alike."""
    options = ["--machine", NAME, "--work", "40", "--seed", "3"]
    for name in ("one", "two"):
        assert main([*options, "--out", str(tmp_path / name)]) == 0
    topics = [
        read_topics(tmp_path / name, [JOINT_STATES, VALVE_COMMAND], [JOINT_REFERENCE])
        for name in ("one", "two")
    ]
    one, two = (read[JOINT_STATES.name] for read in topics)
    position = one.fields["position"]
    np.testing.assert_array_equal(position, two.fields["position"])
    assert (np.ptp(position, axis=0) > 0.3).all()
    command = topics[0][VALVE_COMMAND.name].fields["command"]
    together = (np.abs(command) > 0.15).sum(axis=1)
    assert (together >= 2).mean() > 0.1 and np.abs(command).max() < 1.0
    assert JOINT_REFERENCE.name not in topics[0]


def test_make_bag_takes_a_trajectory_or_work(capsys: pytest.CaptureFixture[str]) -> None:
    for wrong in ([], ["--work", "60", "--trajectory", "x.yaml", "--periods", "1"]):
        with pytest.raises(SystemExit):
            main([*wrong, "--machine", NAME, "--out", "bag"])
        assert "--trajectory and --work: give one of them" in capsys.readouterr().err


def test_a_work_cycle_of_another_machine_is_refused(
    field: tuple[Machine, SimulatedCrane], tmp_path: Path
) -> None:
    text = machine_file("work.yaml", NAME).read_text()
    for change, told in (
        (("boom: 0.20", "mast: 0.20"), "no joint 'mast'"),
        (
            ("boom: 0.20", "boom: 7.0"),
            "boom is 7, must be -1 to 1.15",
        ),
    ):
        path = tmp_path / "work.yaml"
        path.write_text(text.replace(*change))
        with pytest.raises(ConfigurationError, match=told):
            load_work(path, field[0])
