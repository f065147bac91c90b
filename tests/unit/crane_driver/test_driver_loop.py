"""The driver without ROS: frames of a machine in, samples and valve frames out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from unit.crane_driver.driven import disowned

from crane_driver import (
    DriverCodec,
    Fault,
    FaultKind,
    MachineCodec,
    constants,
    load_layout,
    load_safety,
)
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout
from crane_driver.driver_loop import CylinderEffort, DriverLoop, JointSample, PressureSample
from crane_driver.safety.supervisor import SafetyState
from crane_model import generalized_forces, load_machine
from crane_model.machine_files import machine_file
from crane_nodes.this_computer import ProcessorTime

MACHINE = load_machine()
JOINTS = MACHINE.joint_names
PLANAR_JOINTS = JOINTS[1:]
CYCLE = 0.005  # s
START = 20.0  # s, steady
EPOCH = 1_700_000_000 * 10**9  # ns
SPEED = {"slew": 0.1, "inner_boom": 0.02, "outer_boom": -0.05, "telescope": 0.03}
POSE = {"slew": 0.0, "inner_boom": 0.35, "outer_boom": -1.5, "telescope": 0.4}
PRESSURES = {
    **{f"{joint}.a": 8e6 + 1e5 * i for i, joint in enumerate(PLANAR_JOINTS)},
    **{f"{joint}.b": 3e6 - 1e5 * i for i, joint in enumerate(PLANAR_JOINTS)},
    "supply": 17e6,
    "tank": 2e5,
}
pressures = st.floats(0.0, 25e6)  # Pa


class Bench:
    def __init__(self, layout: Layout) -> None:
        density = {"slew": 0.01, "inner_boom": 0.01, "outer_boom": 0.02, "telescope": 0.05}
        self.loop = DriverLoop(
            layout,
            MACHINE,
            load_safety(machine_file("safety.yaml"), load_machine()),
            density,
            START,
        )
        self.machine = MachineCodec(layout)
        self.now, self.count = START, 0

    def learnt(self) -> "Bench":
        """After the cycles in which counters are learnt."""
        for _ in range(constants.LEARNING_FRAMES):
            self.receive(self.frames())
        return self

    def frames(self, faulty: tuple[str, ...] = ()) -> list[Frame]:
        """The next cycle of the machine."""
        self.now, self.count = self.now + CYCLE, self.count + 1
        time = self.count * CYCLE
        positions = {joint: POSE[joint] + SPEED[joint] * time for joint in JOINTS}
        stamp = EPOCH + round(time * 1e9)
        names = [one for one in self.machine.cycles if one != "ValveStatus" or self.count % 2]
        return [
            disowned(
                self.machine.reading_frame(name, positions, PRESSURES, {"valve_unit": "Neutral"}),
                faulty,
            )._replace(stamp=stamp, steady=self.now)
            for name in names
        ]

    def receive(self, frames: list[Frame]) -> tuple[list[JointSample], list[PressureSample]]:
        samples = self.loop.receive(frames, [], self.now)
        self.loop.check(0, self.now, self.now)
        return samples

    def run(self, cycles: int) -> tuple[JointSample, PressureSample]:
        for _ in range(cycles):
            (joints,), (pressures,) = self.receive(self.frames())
        return joints, pressures


@pytest.fixture(scope="module")
def layout() -> Layout:
    return load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))


@pytest.fixture
def fresh(layout: Layout) -> Bench:
    return Bench(layout)


@pytest.fixture
def bench(fresh: Bench) -> Bench:
    return fresh.learnt()


def test_samples_hold_what_the_machine_measured_stamped_when_it_came(bench: Bench) -> None:
    joints, pressures = bench.run(200)
    time = bench.count * CYCLE
    assert joints.stamp == pressures.stamp == EPOCH + round(time * 1e9)
    expected = [POSE[joint] + SPEED[joint] * time for joint in JOINTS]
    assert joints.position == pytest.approx(expected, abs=1e-4)
    assert joints.velocity == pytest.approx(list(SPEED.values()), abs=3e-3)
    assert bench.loop.cylinders == PLANAR_JOINTS
    assert pressures.chamber_a == pytest.approx([8e6, 8.1e6, 8.2e6], abs=1e4)
    assert pressures.chamber_b == pytest.approx([3e6, 2.9e6, 2.8e6], abs=1e4)
    assert (pressures.supply, pressures.tank) == pytest.approx((17e6, 2e5), abs=1e4)


def test_effort_is_the_generalized_force_of_the_pressures_of_the_same_cycle(bench: Bench) -> None:
    joints, pressures = bench.run(1)
    (expected,) = generalized_forces(
        MACHINE,
        np.array([joints.position[1:]]),
        np.array([pressures.chamber_a]),
        np.array([pressures.chamber_b]),
        PLANAR_JOINTS,
    )
    assert math.isnan(joints.effort[0])  # no transducers
    assert joints.effort[1:] == pytest.approx(expected.tolist(), rel=1e-3)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3),
    st.lists(pressures, min_size=6, max_size=6),
)
def test_effort_equals_that_of_arrays_at_every_position_and_pressure(
    places: list[float], chambers: list[float]
) -> None:
    limits = [MACHINE.limits[joint] for joint in PLANAR_JOINTS]
    position = [
        (1.0 - s) * one.position_min + s * one.position_max
        for s, one in zip(places, limits, strict=True)
    ]
    expected = generalized_forces(
        MACHINE,
        np.array([position]),
        np.array([chambers[:3]]),
        np.array([chambers[3:]]),
        PLANAR_JOINTS,
    )
    effort = [
        CylinderEffort(MACHINE, joint)(q, {f"{joint}.a": a, f"{joint}.b": b})
        for joint, q, a, b in zip(PLANAR_JOINTS, position, chambers[:3], chambers[3:], strict=True)
    ]
    assert effort == pytest.approx(expected[0].tolist(), rel=1e-12)


def test_effort_without_pressures_is_not_a_number() -> None:
    assert math.isnan(CylinderEffort(MACHINE, "inner_boom")(0.3, {}))


def test_the_first_sample_has_no_velocity(fresh: Bench) -> None:
    joints = [
        one for _ in range(constants.LEARNING_FRAMES) for one in fresh.receive(fresh.frames())[0]
    ]
    assert len(joints) == 1  # the newest of those that waited
    (joints,) = joints
    assert np.isnan(joints.velocity).all()
    assert np.isfinite(joints.position).all()


def test_joints_wait_half_a_cycle_for_their_pressures_and_no_longer(bench: Bench) -> None:
    bench.run(5)
    frames = bench.frames()
    encoders = [one for one in frames if one.id in (0x120, 0x121)]
    others = [one for one in frames if one not in encoders]
    assert bench.loop.receive(encoders, [], bench.now) == ([], [])
    assert bench.loop.receive([], [], bench.now + 0.4 * CYCLE) == ([], [])
    (joints,), (pressures,) = bench.loop.receive(
        [one._replace(steady=bench.now + 0.4 * CYCLE) for one in others], [], bench.now
    )
    assert joints.stamp == pressures.stamp == frames[0].stamp
    frames = bench.frames()
    assert bench.loop.receive(frames[:2], [], bench.now) == ([], [])
    (joints,), _ = bench.loop.receive([], [], bench.now + 0.5 * CYCLE)
    assert joints.stamp == frames[0].stamp
    assert np.isfinite(joints.effort[1:]).all()  # of the cycle before


def test_effort_of_old_pressures_is_none(bench: Bench) -> None:
    bench.run(5)
    for _ in range(3):
        frames = [one for one in bench.frames() if one.id not in (0x130, 0x131)]
        bench.receive(frames)
        (joints,), pressures = bench.loop.receive([], [], bench.now + 0.5 * CYCLE)
        assert not pressures
    assert np.isnan(joints.effort).all()


def test_a_faulty_sensor_is_not_published_as_if_it_measured(bench: Bench) -> None:
    bench.run(100)
    (joints,), (pressures,) = bench.receive(bench.frames(("telescope", "inner_boom.b")))
    assert math.isnan(joints.position[3])
    assert math.isnan(joints.velocity[3])
    assert np.isfinite(joints.position[:3]).all()
    assert math.isnan(pressures.chamber_b[0])
    assert bench.loop.supervisor.state is SafetyState.FAULT


@pytest.mark.parametrize("filling", [0, 3])
def test_a_damaged_frame_makes_no_sample(filling: int, bench: Bench) -> None:
    bench.run(100)
    frames = bench.frames()
    damaged = bytes([frames[0].data[0], frames[0].data[1], *(6 * [filling])])
    joints, pressures = bench.receive([frames[0]._replace(data=damaged), *frames[1:]])
    assert (len(joints), len(pressures)) == (0, 1)
    assert "checksum EncoderBase" in bench.loop.supervisor.faults


def test_readings_that_stop_are_a_fault(bench: Bench) -> None:
    bench.run(100)
    assert bench.loop.supervisor.state is SafetyState.DISABLED
    bench.now += 1.0
    bench.loop.check(0, bench.now, bench.now)
    assert bench.loop.supervisor.state is SafetyState.FAULT
    assert "missing EncoderBoom" in bench.loop.supervisor.faults


STALL = 0.143  # s


def test_a_stall_of_the_driver_is_no_silence_of_the_machine(bench: Bench) -> None:
    """What came meanwhile waits in the operating system, where one frame after another is read."""
    bench.run(100)
    bench.loop.run(bench.now, spent=ProcessorTime(7.0))
    heard = bench.now
    queued = [bench.frames() for _ in range(round(STALL / CYCLE))]
    bench.loop.run(bench.now, spent=ProcessorTime(7.001))
    for frames in queued:
        bench.loop.receive(frames, [], bench.now)
        bench.loop.check(0, bench.now, heard)
        heard = frames[-1].steady
    bench.run(3)
    supervisor = bench.loop.supervisor
    assert supervisor.state is SafetyState.FAULT
    assert list(supervisor.faults) == ["stalled"]
    assert "after 145 ms" in str(supervisor.faults["stalled"].fault)


def test_a_machine_that_falls_silent_while_the_driver_stalls_is_a_fault_too(bench: Bench) -> None:
    bench.run(100)
    bench.loop.run(bench.now, ProcessorTime(7.0))
    bench.now += STALL
    bench.loop.run(bench.now, ProcessorTime(7.0))
    bench.loop.check(0, bench.now, bench.now)
    first, *others = bench.loop.supervisor.faults
    assert first == "stalled"
    assert "missing EncoderBase" in others


def test_a_receiving_thread_that_stalls_is_told_from_a_silent_machine(bench: Bench) -> None:
    bench.run(100)
    heard = bench.now
    while "stalled" not in bench.loop.supervisor.faults:
        assert bench.now < heard + STALL
        bench.now += CYCLE
        bench.loop.run(bench.now, ProcessorTime(7.0))
        bench.loop.receive([], [], bench.now)
        bench.loop.check(0, bench.now, heard)
    assert bench.loop.supervisor.state is SafetyState.FAULT
    assert list(bench.loop.supervisor.faults) == ["stalled"]
    assert "ms behind the bus" in str(bench.loop.supervisor.faults["stalled"].fault)
    assert bench.now - heard == pytest.approx(0.05, abs=CYCLE)  # as a machine that is late


def test_while_offline_a_stall_is_no_fault_but_delays_what_follows(fresh: Bench) -> None:
    def receive(cycles: int) -> None:
        for _ in range(cycles):
            fresh.receive(fresh.frames())

    fresh.loop.run(fresh.now, ProcessorTime(7.0))
    receive(constants.LEARNING_FRAMES - 5)
    fresh.loop.run(fresh.now, ProcessorTime(7.0))
    receive(30)
    assert fresh.loop.supervisor.state is SafetyState.OFFLINE
    receive(15)
    assert fresh.loop.supervisor.state is SafetyState.DISABLED
    assert not fresh.loop.supervisor.faults


def test_positions_of_which_no_cycle_is_complete_stop_the_crane(bench: Bench) -> None:
    """Every frame comes often enough by itself, but the limits would be kept by old positions."""
    bench.run(100)
    bench.loop.supervisor.enable(bench.now)
    for count in range(15):
        lost = 0x120 if count % 2 else 0x121
        joints, _ = bench.receive([one for one in bench.frames() if one.id != lost])
        assert not joints
        bench.loop.valve_frames(bench.now)
    assert bench.loop.supervisor.state is SafetyState.FAULT
    assert "no state" in bench.loop.supervisor.faults


def test_a_lost_bus_is_a_fault(bench: Bench) -> None:
    bench.run(100)
    bench.loop.receive([], [Fault(FaultKind.BUS, "interface down")], bench.now)
    assert str(bench.loop.supervisor.faults["bus"].fault) == "bus: interface down"


def test_valve_frames_come_with_their_cycle(bench: Bench) -> None:
    sent = [len(bench.loop.valve_frames(START + k * CYCLE / 5)) for k in range(100)]
    assert sum(sent) == pytest.approx(20, abs=1)


def test_commands_are_sent_on_at_once_and_take_the_place_of_the_cycle(bench: Bench) -> None:
    """Commands in the middle of the cycle of the timer."""
    times = [START + k * CYCLE / 2 for k in range(100)]
    by_timer, by_command = 0, 0
    for k, now in enumerate(times):
        if k % 2:
            by_command += len(bench.loop.valve_frames(now, commanded=True))
        else:
            by_timer += len(bench.loop.valve_frames(now))
    assert by_command == 50
    assert by_timer <= 1
    # A flood of commands does not flood the bus.
    flood = [bench.loop.valve_frames(times[-1] + k * 1e-4, commanded=True) for k in range(500)]
    assert sum(map(len, flood)) <= 0.05 / CYCLE * 2 + 1


def test_a_command_too_soon_after_another_is_sent_half_a_cycle_after_it(bench: Bench) -> None:
    now = START + 10 * CYCLE
    assert bench.loop.valve_frames(now, commanded=True)
    assert not bench.loop.valve_frames(now + 0.2 * CYCLE, commanded=True)
    assert not bench.loop.valve_frames(now + 0.3 * CYCLE)
    assert bench.loop.valve_frames(now + 0.5 * CYCLE)
    assert not bench.loop.valve_frames(now + 1.3 * CYCLE)


def test_a_valve_frame_of_the_cycle_does_not_hold_up_the_commands_that_follow_it(
    bench: Bench,
) -> None:
    """As in a loop in which every command comes soon after the frames that woke the driver."""
    now = START + 10 * CYCLE
    assert bench.loop.valve_frames(now - 0.7 * CYCLE, commanded=True)
    assert not bench.loop.valve_frames(now - 0.3 * CYCLE, commanded=True)  # waits for a wake-up
    late = 0
    for k in range(20):
        bench.loop.valve_frames(now + k * CYCLE)
        late += not bench.loop.valve_frames(now + (k + 0.16) * CYCLE, commanded=True)
    assert not late


def test_unknown_frames_are_counted(bench: Bench) -> None:
    bench.receive([Frame(0x7FF, b"", steady=bench.now)])
    assert bench.loop.codec.unknown == {(0x7FF, False): 1}


@pytest.mark.parametrize("state", ["offline", "disabled", "enabled", "emergency stop"])
def test_a_valve_frame_of_another_node_is_a_fault_in_every_state(state: str, fresh: Bench) -> None:
    bench = fresh if state == "offline" else fresh.learnt()
    foreign = DriverCodec(bench.loop.codec.layout).command_frames({"inner_boom": 0.4}, True)
    supervisor = bench.loop.supervisor
    if state != "offline":
        bench.run(100)
    if state == "enabled":
        supervisor.enable(bench.now)
    elif state == "emergency stop":
        supervisor.emergency_stop()
    assert supervisor.state == state
    bench.receive([one._replace(steady=bench.now) for one in foreign])
    assert supervisor.state is (
        SafetyState.ESTOP if state == "emergency stop" else SafetyState.FAULT
    )
    text = supervisor.faults["foreign command ValveCommand"].fault.detail
    assert "another node commands the valves" in text
    assert "inner_boom 0.4" in text
    assert bench.loop.codec.unknown == {}


def test_a_position_that_jumps_is_a_fault_and_is_not_published_until_reset(bench: Bench) -> None:
    bench.run(100)
    before = POSE["inner_boom"]
    try:
        POSE["inner_boom"] -= 0.3
        joints, _ = bench.run(3)
        assert math.isnan(joints.position[1])
        assert math.isnan(joints.effort[1])
        assert np.isfinite([joints.position[0], *joints.position[2:]]).all()
        supervisor = bench.loop.supervisor
        assert supervisor.state is SafetyState.FAULT
        fault = supervisor.faults["jumped inner_boom"].fault
        assert str(fault).startswith("inner_boom: jumped: its position jumped by -0.3")
        supervisor.reset(bench.now)
        joints, _ = bench.run(100)
        assert supervisor.state is SafetyState.DISABLED
        assert math.isfinite(joints.position[1])
    finally:
        POSE["inner_boom"] = before


def test_a_valve_frame_of_the_driver_that_comes_again_is_a_fault(bench: Bench) -> None:
    bench.run(100)
    frames = bench.loop.valve_frames(bench.now)
    assert frames
    bench.receive([one._replace(steady=bench.now) for one in frames])
    fault = bench.loop.supervisor.faults["foreign command ValveCommand"].fault
    assert "came back" in fault.detail
