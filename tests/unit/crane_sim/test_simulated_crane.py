"""The machine on its bus without a bus: frames in, frames out, and a clock that the test moves."""

import signal
import threading
from collections.abc import Callable

import numpy as np
import pytest
from known_crane import known_model

from crane_driver import DriverCodec, load_layout
from crane_driver.can.codec import Readings
from crane_driver.can.frame import START_NS, STEP, TIME, Frame, step_frame, time_frame, told_time
from crane_driver.can.health import Monitor
from crane_driver.can.layout import Layout
from crane_model import RangeError, load_machine
from crane_model.machine_files import machine_file
from crane_sim import Plant, Sensors, load_simulated_crane
from crane_sim.machine_on_bus import COMMAND_TIMEOUT_S, MAX_STEP_S, MachineOnBus, ValveUnit
from crane_sim.plant.closed_loop import IdentifiedPlant
from crane_sim.plant.sampled import MachineInMotion
from crane_sim.sensor_faults import Faults
from crane_sim.simulated_crane import MAX_BACKLOG_CYCLES, LockStep, PlantPace, main

JOINTS = load_machine().joint_names

START = 1000.0  # s, steady
CYCLE = 0.005  # s
NO_TIME = 1e-6  # s, rounding


class Bench:
    """A machine on its bus, and the driver's end of it."""

    def __init__(self, layout: Layout, twin: bool = False):
        machine, parameters = load_machine(), load_simulated_crane()
        plant: MachineInMotion = Plant(parameters, machine, parameters.start)
        if twin:
            plant = IdentifiedPlant(known_model(), machine, np.array(parameters.start))
        self.faults = Faults(machine)
        sensors = Sensors(parameters.sensors, machine, 1, timed=self.faults)
        self.machine = MachineOnBus(layout, plant, sensors, START)
        self.plant = plant
        self.driver = DriverCodec(layout)
        self.monitor = Monitor(layout.readings, layout.timing, START)
        self.now = START

    def cycle(self, frames: list[Frame]) -> list[Readings]:
        """One cycle with frames that come at its beginning; what the driver reads of the answer."""
        received = [frame._replace(steady=self.now) for frame in frames]
        answers = self.machine.exchange(received)
        self.now += CYCLE
        self.machine.run(self.now)
        readings = [self.driver.decode(one._replace(steady=self.now)) for one in answers]
        return [one for one in readings if one]

    def command(self, enabled: bool = True, **commands: float) -> list[Readings]:
        return self.cycle(self.driver.command_frames(commands, enabled))


@pytest.fixture(scope="module")
def layout() -> Layout:
    return load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))


@pytest.fixture
def bench(layout: Layout) -> Bench:
    return Bench(layout)


@pytest.mark.parametrize("twin", [False, True])
def test_the_driver_reads_what_the_plant_does(layout: Layout, twin: bool) -> None:
    bench = Bench(layout, twin)
    before = bench.plant.q
    positions: dict[str, float] = {}
    pressures: dict[str, float] = {}
    for _ in range(20):
        plant = bench.plant  # as the readings of the next frames were taken
        q, supply = plant.q, plant.supply_pressure
        pressure_a, pressure_b = plant.pressure_a, plant.pressure_b
        for readings in bench.command(telescope=0.5):
            assert not bench.monitor.observe(readings)
            positions |= readings.positions
            pressures |= readings.pressures
    assert [positions[joint] for joint in JOINTS] == pytest.approx(q, abs=1e-4)
    assert q[3] > before[3] + 0.01
    assert pressures["inner_boom.a"] == pytest.approx(pressure_a[1], abs=1e5)
    assert pressures["telescope.b"] == pytest.approx(pressure_b[3], abs=1e5)
    assert pressures["supply"] == pytest.approx(supply, abs=1e5)
    assert np.abs(q - before)[:2].max() < 0.002


def test_an_encoder_freezes_in_mid_motion_with_valid_counters(bench: Bench) -> None:
    shown: list[float] = []
    for k in range(80):
        if k == 40:
            bench.faults.add("telescope.encoder.stuck")
            moving = bench.plant.q[3]
        for readings in bench.command(telescope=0.5):
            assert not bench.monitor.observe(readings)
            shown += [q for one, q in readings.positions.items() if one == "telescope"]
    seen = set(shown[-30:])
    assert len(set(shown[:30])) > 20
    assert bench.plant.q[3] > moving + 0.01
    assert len(seen) == 1
    bench.faults.mend("telescope.encoder")
    bench.command(telescope=0.5)
    (now,) = (one.positions["telescope"] for one in bench.command(telescope=0.5)
              if "telescope" in one.positions)  # fmt: skip
    assert now > moving + 0.01


def test_each_message_comes_with_its_cycle_time(bench: Bench) -> None:
    names = [readings.message for _ in range(10) for readings in bench.cycle([])]
    assert {name: names.count(name) for name in names} == {
        "EncoderBase": 10,
        "EncoderBoom": 10,
        "PressureBooms": 10,
        "PressureTelescope": 10,
        "ValveStatus": 5,
    }


def states(many: list[list[Readings]]) -> list[str]:
    return [one.states["valve_unit"] for cycle in many for one in cycle if one.states]


def test_valves_go_neutral_when_commands_stop(bench: Bench) -> None:
    assert set(states([bench.command(telescope=1.0) for _ in range(20)])) == {"Enabled"}
    silent = [bench.cycle([]) for _ in range(40)]
    shown = states(silent)
    assert 18 * CYCLE <= 2 * CYCLE * shown.count("Enabled") <= COMMAND_TIMEOUT_S + 2 * CYCLE
    assert shown[-1] == "CommandTimeout"

    assert np.abs(bench.plant.spool).max() < 0.01


def test_valves_that_timed_out_stay_neutral_until_a_command_that_does_not_enable(
    bench: Bench,
) -> None:
    bench.command(telescope=1.0)
    for _ in range(25):
        bench.cycle([])
    again = [bench.command(telescope=1.0) for _ in range(10)]
    assert set(states(again)) == {"CommandTimeout"}
    bench.command(enabled=False)
    assert set(states([bench.command(telescope=1.0) for _ in range(4)])) == {"Enabled"}


def test_commands_that_do_not_enable_move_nothing(bench: Bench) -> None:
    for _ in range(20):
        bench.command(enabled=False, telescope=1.0)
    assert np.abs(bench.plant.spool).max() == 0.0


def flip_checksum(frame: Frame) -> Frame:
    return frame._replace(data=bytes([frame.data[0] ^ 1]) + frame.data[1:])


@pytest.mark.parametrize(
    "damage",
    [flip_checksum, lambda frame: frame._replace(data=frame.data[:7])],
    ids=["checksum", "size"],
)
def test_a_damaged_command_is_not_accepted(
    damage: Callable[[Frame], Frame], layout: Layout
) -> None:
    bench = Bench(layout)
    for _ in range(10):
        bench.cycle([damage(one) for one in bench.driver.command_frames({"slew": 1.0}, True)])
    assert bench.machine.valves.refused == 10
    assert np.abs(bench.plant.spool).max() == 0.0


def test_a_command_that_is_repeated_does_not_keep_the_valves_open(bench: Bench) -> None:
    frames = bench.driver.command_frames({"slew": 1.0}, True)
    shown = states([bench.cycle(frames) for _ in range(40)])
    assert (shown[0], shown[-1]) == ("Enabled", "CommandTimeout")


def test_a_frame_that_came_late_does_not_hide_a_timeout(layout: Layout) -> None:
    bench = Bench(layout)
    unit: ValveUnit = bench.machine.valves
    for after in (0.0, COMMAND_TIMEOUT_S + 0.01):
        (frame,) = bench.driver.command_frames({"slew": 1.0}, True)
        unit.receive(frame._replace(steady=START + after))
    assert unit.state == "CommandTimeout"


def test_a_machine_that_was_kept_from_running_loses_time(bench: Bench) -> None:
    bench.machine.run(START + 1.0)
    assert bench.machine.lost == pytest.approx(1.0 - MAX_STEP_S)
    assert bench.plant.time == pytest.approx(MAX_STEP_S)


def test_pace_makes_up_for_short_delays_and_reports_long_ones() -> None:
    pace = PlantPace(CYCLE, START)
    assert pace.pause(START) == pytest.approx(CYCLE)
    assert pace.next(START + CYCLE) is None
    assert pace.next(START + 4 * CYCLE) is None  # two cycles late
    assert pace.pause(START + 4 * CYCLE) == 0.0
    assert pace.left_out == 0
    late = START + 3.0
    report = pace.next(late)
    assert report and "not in real time" in report
    assert pace.left_out == pytest.approx((late - START) / CYCLE - 3, abs=1)
    assert 0.0 <= pace.pause(late) <= CYCLE + NO_TIME
    assert pace.longest > MAX_BACKLOG_CYCLES * CYCLE
    assert pace.next(late + CYCLE) is None  # said once


class LateDriver:
    """A link to a driver that answers a time when it is told it again."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def take(self) -> list[Frame]:
        frames, self.frames = self.frames, []
        return frames

    def send(self, frame: Frame) -> None:
        told = told_time(frame, TIME)
        assert told is not None
        self.frames.append(step_frame(told))


def test_a_driver_that_answers_late_is_waited_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a new driver, which never answers within a cycle of real time, would never be heard."""
    monkeypatch.setattr("crane_sim.simulated_crane.PATIENCE_S", 0.0)
    link, stop = LateDriver(), threading.Event()
    crane = LockStep(link, threading.Event(), CYCLE)  # type: ignore[arg-type]
    link.frames = [step_frame(crane.time)]
    crane.wait(stop, [time_frame(crane.time)])  # the driver is there
    crane.wait(stop, [time_frame(crane.time)])  # and gone: time goes on
    assert crane.answer == []
    monkeypatch.undo()
    link.frames = [step_frame(START_NS)]
    crane.wait(stop, [time_frame(crane.time)])
    assert [told_time(one, STEP) for one in crane.answer] == [START_NS, START_NS + 2e9 * CYCLE]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--pose", "elbow=1"], "pose 'elbow=1': no joint 'elbow'; write JOINT=VALUE"),
        (["--pose", "telescope=5"], "telescope: the plant cannot start at 5 m"),
        (["--bus-option", "port"], "bus option 'port': write KEY=VALUE"),
        (["--interface", "carrier_pigeon"], "carrier_pigeon"),
        (["--bitrate", "-1"], "bus: key 'bitrate': must be greater than 0"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    handler = signal.getsignal(signal.SIGTERM)
    assert main(arguments) == 1
    assert message in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is handler


def test_the_machine_may_have_been_running(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def plant(*_: object, running: float) -> MachineInMotion:
        raise RangeError(f"has been running for {running:g} s")

    monkeypatch.setattr("crane_sim.simulated_crane.Plant", plant)
    assert main(["--running", "600"]) == 1
    assert "has been running for 600 s" in capsys.readouterr().err
