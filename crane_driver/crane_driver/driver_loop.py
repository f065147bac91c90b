"""The driver without ROS: frames to samples, commands to frames, faults to the supervisor."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from crane_driver import constants
from crane_driver.can.assembly import Assembly, Complete
from crane_driver.can.canopen import Devices
from crane_driver.can.codec import DriverCodec
from crane_driver.can.frame import Frame
from crane_driver.can.health import (
    Acceptance,
    ForeignCommands,
    HeardCommand,
    HeardCommands,
    Monitor,
    usable,
)
from crane_driver.can.layout import Layout
from crane_driver.can.mapping import LINES
from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.commands import SafetySettings, check_valves
from crane_driver.safety.plausibility import JointEstimate, PositionWatch, believed
from crane_driver.safety.supervisor import Level, LogEntry, SafetyState, Supervisor
from crane_driver.velocity_filter import VelocityFilter
from crane_model.linkages import motion
from crane_model.machine import Machine
from crane_nodes.this_computer import ProcessorTime

# Which remedy fits where it is not the want of priority, which the kind of the fault names.
REAL_TIME_REMEDY = (
    "it has real-time priority: let all that has it use at most half of the cores, as "
    "docs/how_to/real_time.md says, or take a faster computer"
)
STOPPED_REMEDY = (
    "it was stopped: look for a debugger, a suspended computer, or a disk that it waited for"
)


class StallWatch:
    """Judges by the steady clock how long the loop of the driver did not run."""

    def __init__(self, limit: float):
        """`limit` [s]: a longer pause is a stall."""
        self._limit = limit
        self._ran, self._spent = math.nan, ProcessorTime(math.nan)

    def ran(self, now: float, spent: ProcessorTime) -> Fault | None:
        """Return the stall that ends when the loop runs at `now` [s], with the time `spent` so far.

        The first run has nothing to be late by.
        """
        pause, before = now - self._ran, self._spent
        self._ran, self._spent = now, spent
        if not pause > self._limit:
            return None
        computed, waited = spent.computed - before.computed, spent.waited - before.waited
        kind, advice = FaultKind.STALLED, ""
        if computed > pause / 2:
            kind = FaultKind.OVERWORKED
        elif waited < pause / 2:
            advice = STOPPED_REMEDY
        elif spent.priority:
            advice = REAL_TIME_REMEDY
        said = (
            f"{kind.cause}: after {pause * 1e3:.0f} ms, limit {self._limit * 1e3:.0f} ms; it "
            f"computed for {computed * 1e3:.0f} ms"
        )
        if math.isfinite(waited):
            said += f" and waited for a processor for {waited * 1e3:.0f} ms"
        return Fault(kind, said, advice=advice)


def behind(now: float, heard: float) -> Fault:
    """That frames wait at `now` [s] that came after `heard`, though the loop runs."""
    kind = FaultKind.STALLED
    return Fault(kind, f"{kind.cause}: it is {(now - heard) * 1e3:.0f} ms behind the bus")


class JointSample(NamedTuple):
    """Joints in the order of `DriverLoop.joints`; NaN where there is no measurement."""

    stamp: int  # ns, of the sampling as reception tells it
    position: list[float]  # rad, m
    velocity: list[float]  # rad/s, m/s
    effort: list[float]  # N m, N: generalized force (27) of the pressures


class PressureSample(NamedTuple):
    """Cylinders in the order of `DriverLoop.cylinders` [Pa]; NaN where there is no measurement."""

    stamp: int  # ns, of the sampling as reception tells it
    chamber_a: list[float]
    chamber_b: list[float]
    supply: float
    tank: float


class _Measured(NamedTuple):
    """Joints whose pressures are still to come."""

    positions: Complete
    velocities: list[float]


class CylinderEffort:
    """Generalized force (27) of the actuator of one joint, for one instant at a time."""

    def __init__(self, machine: Machine, joint: str):
        actuator, limits = machine.cylinders[joint], machine.limits[joint]
        self._linkage = actuator.linkage(limits.position_min, limits.position_max)
        self._area_a, self._area_b = actuator.area_a, actuator.area_b
        self._chamber_a, self._chamber_b = f"{joint}.a", f"{joint}.b"

    def __call__(self, position: float, pressures: Mapping[str, float]) -> float:
        """Force [N m, N] at a position [rad, m] of the joint, by pressures [Pa] with their names as
        in `Layout.pressures`; NaN if those of its chambers are not among them.
        """
        kind, lengths = self._linkage
        lever: float = motion(kind, lengths, position)[1]
        pressure_a = pressures.get(self._chamber_a, math.nan)
        pressure_b = pressures.get(self._chamber_b, math.nan)
        return lever * (self._area_a * pressure_a - self._area_b * pressure_b)


class DriverLoop:
    """One thread calls `receive` when frames have come, and `check` and `valve_frames` in every
    cycle of the valve frames; before anything else, `run`. Times are of the steady clock [s].
    """

    def __init__(
        self,
        layout: Layout,
        machine: Machine,
        settings: SafetySettings,
        jerk_density: Mapping[str, float],
        now: float,
        listen_only: bool = False,
    ):
        """listen_only: send nothing. `ConfigurationError`: a joint has a valve but no position."""
        valves = () if listen_only else layout.valves
        check_valves(valves, layout.positions)
        self.listen_only = listen_only
        self._heard = HeardCommands(layout)
        self._commands_heard: list[HeardCommand] = []
        self.joints = tuple(joint for joint in machine.joint_names if joint in layout.positions)
        measured = {name.split(".")[0] for name in layout.pressures if name not in LINES}
        self.cylinders = tuple(joint for joint in machine.joint_names if joint in measured)
        self.cycle = min(
            message.cycle for message in (layout.commands if valves else layout.readings)
        )
        self.frames_of_cycle = layout.frames_of_cycle
        self.codec = DriverCodec(layout)
        self.monitor = Monitor(layout.readings, layout.timing, now)
        self._acceptance = Acceptance(layout, settings.command_timeout)
        self._foreign = ForeignCommands(layout)
        self.devices = Devices(layout.devices)
        self.supervisor = Supervisor(valves, machine, settings, now, listen_only)
        self._machine, self._settings = machine, settings
        self._resolution = {joint: layout.resolution(joint) for joint in valves}
        self._positions = Assembly(layout, "positions")
        self._position_cycle = max(
            message.cycle for message in layout.readings if message.positions
        )
        self._blind = layout.timing.late * self._position_cycle  # s without a complete cycle
        self._stalls = StallWatch(self._blind)
        self._watches = self._new_watches()
        self._located = -math.inf  # reception of the newest one
        self._pressures = Assembly(layout, "pressures")
        cycles = [message.cycle for message in layout.readings if message.pressures]
        self._pressure_cycle = max(cycles, default=0.0)
        self._newest: Complete | None = None  # pressures
        self._waiting: _Measured | None = None
        density = [jerk_density[joint] for joint in self.joints]
        resolution = [layout.resolution(joint) for joint in self.joints]
        self._filter = VelocityFilter(density, resolution)
        self._commanded = -math.inf  # the newest valve frame that a command caused
        self._due = now
        self._efforts = {
            joint: CylinderEffort(machine, joint) if joint in machine.cylinders else None
            for joint in self.joints
        }
        self._chambers_a = [f"{joint}.a" for joint in self.cylinders]
        self._chambers_b = [f"{joint}.b" for joint in self.cylinders]
        self._compile(density, resolution)

    @property
    def incomplete(self) -> int:
        """Cycles that were given up because one of their frames did not come."""
        return self._positions.incomplete + self._pressures.incomplete

    def run(self, now: float, spent: ProcessorTime) -> None:
        """The loop runs, and has `spent` so much processor time so far.

        Comes before all that may be late only because the loop did not run.
        """
        if stall := self._stalls.ran(now, spent):
            self.supervisor.stalled(stall, now)

    def receive(
        self, frames: Sequence[Frame], bus_faults: Sequence[Fault], now: float
    ) -> tuple[list[JointSample], list[PressureSample]]:
        """The samples that `frames` complete; what is wrong goes to the supervisor."""
        joints: list[JointSample] = []
        pressures: list[PressureSample] = []
        self.supervisor.can_faults(bus_faults, now)
        for frame in frames:
            if (of_device := self.devices.observe(frame)) is not None:
                self.supervisor.can_faults(of_device, now)
                continue
            if self.listen_only:
                command, faults = self._heard.observe(frame)
                self.supervisor.can_faults(faults, now)
                self._commands_heard += [command] if command else []
            elif foreign := self._foreign.observe(frame):
                self.supervisor.can_faults([foreign], now)
                continue
            readings = self.codec.decode(frame)
            if readings is None:
                continue
            if faults := self.monitor.observe(readings):
                substituted = self.supervisor.substituted  # whatever its encoder says is not heard
                heeded = [
                    fault for fault in faults if not substituted or fault.reading != substituted
                ]
                self.supervisor.can_faults(heeded, now)
                if not usable(faults):
                    continue
            if readings.accepted:
                self.supervisor.can_faults(self._acceptance.observe(readings), now)
            for complete in self._pressures.add(readings):
                self._newest = complete
                pressures.append(self._pressure_sample(complete))
                joints += self._joint_samples(readings.steady)
            # Cycles that had to wait until they had numbers are too old for who moves the crane.
            for complete in self._positions.add(readings)[-1:]:
                joints += self._joint_samples(math.inf)  # of the cycle before
                self._waiting = self._measured(complete)
                joints += self._joint_samples(readings.steady)
        joints += self._joint_samples(now)
        return joints, pressures

    def take_heard(self) -> list[HeardCommand]:
        heard, self._commands_heard = self._commands_heard, []
        return heard

    def sampled(self, stamp: int) -> float:
        """When pressures of `stamp` [ns] were sampled [s, steady]; NaN while none were."""
        newest = self._newest
        return newest.sampled + (stamp - newest.stamp) * 1e-9 if newest else math.nan

    def estimate(self, joint: str, estimate: JointEstimate) -> None:
        """Take an estimate of a joint, which counts if its encoder is substituted."""
        if joint == self.supervisor.substituted and self._newest is not None:
            self.supervisor.estimated(estimate, self._newest.sampled)

    def check(self, publishers: int, now: float, heard: float) -> None:
        """Check for missing messages, with the number of publishers of commands.

        `heard`: everything that came until then has been received; later messages are not missing
        yet.
        """
        self.supervisor.can_faults(self.monitor.check(heard) + self.devices.check(heard), now)
        self.supervisor.log += [LogEntry(Level.WARNING, text) for text in self.devices.take_log()]
        if now - self._located > self._blind:  # though each frame by itself may come in time
            if now - heard > heard - self._located:
                self.supervisor.stalled(behind(now, heard), now)
            self.supervisor.readings({}, {})
        self.supervisor.published_by(publishers)
        self.supervisor.ready(self.monitor.complete and self.devices.operational, now)

    def device_frames(self, now: float) -> list[Frame]:
        """Frames that start CANopen devices: only while the state is offline, with neutral valves,
        so that a device that failed in operation stays as it is until the fault is reset.
        """
        return self.devices.start(now) if self.supervisor.state is SafetyState.OFFLINE else []

    def valve_frames(self, now: float, commanded: bool = False) -> list[Frame]:
        """The valve frames if they are due at `now`, else none; never, if it only listens.

        A command is sent on at once (`commanded`), so that it does not wait for the cycle; one that
        comes too soon after another, as soon as it may follow. A frame of the cycle holds up no
        command: sent just before the commands of a loop, it would hold up every one of them.
        """
        if self.listen_only:
            return []
        if commanded:
            if now - self._commanded < constants.CLOSEST_FRAMES_CYCLES * self.cycle:
                self._due = self._commanded + constants.CLOSEST_FRAMES_CYCLES * self.cycle
                return []
            self._commanded = now
        elif now < self._due - constants.TIMER_EARLY_CYCLES * self.cycle:
            return []
        self._due = now + (constants.COMMAND_GRACE_CYCLES if commanded else 1.0) * self.cycle
        output = self.supervisor.output(now)
        frames = self.codec.command_frames(output.commands, output.enabled)
        for frame in frames:
            self._acceptance.sent(frame, now)
            self._foreign.sent(frame)
        return frames

    def _new_watches(self) -> dict[str, PositionWatch]:
        return {
            joint: PositionWatch(
                joint, self._machine.limits[joint], resolution, self._position_cycle, self._settings
            )
            for joint, resolution in self._resolution.items()
        }

    def _believed(self, positions: Complete) -> Complete:
        """Without the readings that cannot be true, which are faults."""
        if self.supervisor.state is SafetyState.OFFLINE:  # as after every reset
            self._watches = self._new_watches()
        read = dict(positions.values)
        if substituted := self.supervisor.substituted:
            read[substituted] = math.nan
        values, wrong = believed(
            self._watches,
            positions.sampled,
            read,
            self.supervisor.sent,
            self._newest.values if self._newest else {},
        )
        self.supervisor.not_believed(wrong)
        return positions._replace(values=values)

    def _measured(self, positions: Complete) -> _Measured:
        positions = self._believed(positions)
        readings = [positions.values[joint] for joint in self.joints]
        velocities = self._filter.update(positions.sampled, readings).velocity.tolist()
        self._located = positions.received
        self.supervisor.readings(positions.values, dict(zip(self.joints, velocities, strict=True)))
        return _Measured(positions, velocities)

    def _joint_samples(self, now: float) -> list[JointSample]:
        """Return waiting joints with the pressures of their cycle, after half a cycle at most."""
        if self._waiting is None:
            return []
        positions, velocities = self._waiting
        half = self._pressure_cycle / 2
        newest = self._newest
        together = newest is not None and abs(newest.sampled - positions.sampled) <= half
        if not together and now - positions.received < half:
            return []
        self._waiting = None
        readings = [positions.values[joint] for joint in self.joints]
        return [JointSample(positions.stamp, readings, velocities, self._effort(positions))]

    def _effort(self, complete: Complete) -> list[float]:
        """(27) by the newest pressures, unless they are older than the positions by a cycle."""
        newest = self._newest
        if newest is None or abs(complete.sampled - newest.sampled) > 1.5 * self._pressure_cycle:
            return [math.nan] * len(self.joints)
        return [
            effort(complete.values[joint], newest.values) if effort else math.nan
            for joint, effort in self._efforts.items()
        ]

    def _pressure_sample(self, complete: Complete) -> PressureSample:
        values = complete.values
        return PressureSample(
            complete.stamp,
            [values.get(name, math.nan) for name in self._chambers_a],
            [values.get(name, math.nan) for name in self._chambers_b],
            values.get("supply", math.nan),
            values.get("tank", math.nan),
        )

    def _compile(self, density: Sequence[float], resolution: Sequence[float]) -> None:
        """Run once what numba compiles: later it would hold up the frames for seconds."""
        VelocityFilter(density, resolution).update(0.0, [0.0] * len(self.joints))
        for effort in filter(None, self._efforts.values()):
            effort(0.0, {})
