"""The active driver: frames become samples, commands become frames, in the executor's thread."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from crane_bags.clocks import TimeBack
from crane_driver import constants
from crane_driver.can.bus import BusError
from crane_driver.can.frame import Frame
from crane_driver.can.link import Link
from crane_driver.driver_loop import DriverLoop
from crane_driver.driver_messages import cylinder_pressures, joint_state, valve_output
from crane_driver.faults import Fault, FaultKind
from crane_driver.safety.commands import RefusedError
from crane_driver.safety.plausibility import JointEstimate
from crane_driver.safety.supervisor import Level
from crane_interfaces.msg import PositionEstimate, SensorFindings, ValveCommand
from crane_nodes.driver_client import LATCHED
from crane_nodes.node_time import nanoseconds
from crane_nodes.this_computer import RealTime, RealTimeSettings, ThreadClock

COMMAND_DEPTH = 10  # messages


class ActiveDriver:
    """From `begin` to `end`, `loop` runs over the open `link` and publishes what it measures.

    `report` is called at every change of the safety state.
    """

    def __init__(
        self,
        node: Node,
        loop: DriverLoop,
        link: Link,
        joints: Publisher,
        pressures: Publisher,
        outputs: Publisher,
        report: Callable[[], None],
    ):
        self.loop, self.link = loop, link
        self._node, self._log = node, node.get_logger()
        self._joints, self._pressures, self._outputs = joints, pressures, outputs
        self._report = report
        self._realtime: RealTime | None = None
        self._spent = ThreadClock()
        self._commands: Subscription | None = None
        self._estimates: Subscription | None = None
        self._findings: Subscription | None = None
        self._begun = 0  # ns; earlier if the clock was set back since
        self._back = TimeBack()
        self._timer: Timer | None = None

    def begin(self, realtime: RealTimeSettings) -> None:
        self._be_punctual(realtime)
        if not self.loop.listen_only:
            self._commands = self._node.create_subscription(
                ValveCommand,
                "valve_command",
                self._command,  # type: ignore[arg-type]  # rclpy omits the second argument
                COMMAND_DEPTH,
            )
        self._begun = self._stamp()
        self._findings = self._node.create_subscription(
            SensorFindings, "sensor_findings", self._found, LATCHED
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self._node.create_timer(self.loop.cycle, self._due, clock=steady)

    def end(self) -> None:
        if self._timer:
            self._node.destroy_timer(self._timer)
        for subscription in filter(None, (self._commands, self._estimates, self._findings)):
            self._node.destroy_subscription(subscription)
        moving = not self.loop.listen_only
        if moving:
            self.loop.supervisor.disable()
        while moving:
            output = self.loop.supervisor.output(self._now())
            moving = output.enabled
            with suppress(BusError):  # without a bus the valve electronics time out
                self._write(self.loop.codec.command_frames(output.commands, output.enabled))
            self._pause()
        self.link.close()
        self._spent.close()
        if self._realtime:
            self._realtime.end()

    def _be_punctual(self, settings: RealTimeSettings) -> None:
        self._realtime = realtime = RealTime(settings).begin()
        if realtime.obtained:
            self._log.info(f"real time: {', '.join(realtime.obtained)}")
        if realtime.refused:
            self._log.warning(
                f"real time: no {'; no '.join(realtime.refused)}. Beside other work the driver may "
                "stall: permit it (share/crane_driver/realtime), or do not ask for it (parameters "
                "realtime.*)"
            )

    # frames and commands

    def receive(self) -> None:
        self._take()
        self._drive(self.loop.valve_frames(self._runs()))

    def _now(self) -> float:
        """The time by which everything is judged [s]: that of the steady clock."""
        return time.monotonic()

    def _stamp(self) -> int:
        return time.time_ns()

    def _pause(self) -> None:
        time.sleep(self.loop.cycle)

    def _runs(self) -> float:
        """Judge whether the loop has run until now, and return the time.

        To be called right before anything is judged by the time: the process may have been stopped
        anywhere, and a message that is late only for that is not a fault of its sender.
        """
        now = self._now()
        self.loop.run(now, self._spent.read())
        return now

    def _take(self) -> None:
        self._publish(self.link.take(constants.FRAMES_AT_ONCE))

    def _publish(self, frames: Sequence[Frame]) -> None:
        joints, pressures = self.loop.receive(frames, self.link.take_faults(), self._runs())
        for pressure_sample in pressures:
            self._pressures.publish(cylinder_pressures(pressure_sample, self.loop.cylinders))
        for joint_sample in joints:
            if self._back.comes("joint_states", joint_sample.stamp):
                self._begun = min(self._begun, joint_sample.stamp)
                self._log.warning(
                    f"the clock was set back by {self._back.by:.1f} s: stamps follow it; bags of "
                    "this moment are refused"
                )
            self._joints.publish(joint_state(joint_sample, self.loop.joints))
        for heard in self.loop.take_heard():
            self._outputs.publish(valve_output(heard.stamp, heard.commands))

    def _due(self) -> None:
        """Do the work of a cycle of the valve frames."""
        self._take()  # before it is judged what has not come
        now = self._runs()
        self._judge(now, self.link.heard(now))
        self._answer(now)

    def _judge(self, now: float, heard: float) -> None:
        self.loop.check(self._commanders(), now, heard)
        self.tell()

    def _answer(self, now: float) -> None:
        self._drive(self.loop.valve_frames(now))
        self._send(self.loop.device_frames(now))
        self.tell()

    def _command(self, message: ValveCommand, info: dict[str, Any]) -> None:
        age = (time.time_ns() - info["received_timestamp"]) * 1e-9
        received = self._runs() - (age if 0.0 <= age < constants.OLDEST_COMMAND_S else 0.0)
        if self._commanded(message, received):
            self._drive(self.loop.valve_frames(self._runs(), commanded=True))

    def _commanded(self, message: ValveCommand, received: float) -> bool:
        """Take a command that came at `received` [s]; return whether it was accepted."""
        self.loop.supervisor.published_by(self._commanders())
        try:
            self.loop.supervisor.command(message.name, message.command, received)
        except RefusedError as error:
            self._log.warning(str(error), throttle_duration_sec=constants.WARNING_PERIOD_S)
            return False
        return True

    def _estimated(self, message: PositionEstimate) -> None:
        sampled = self.loop.sampled(nanoseconds(message.header.stamp))
        motions = zip(message.position, message.velocity, message.std_dev, strict=False)
        for joint, motion in zip(message.name, motions, strict=False):
            self.loop.estimate(joint, JointEstimate(sampled, *motion, message.condition))

    def _found(self, message: SensorFindings) -> None:
        told = zip(message.joint, message.sensor, message.kind, message.dangerous, strict=False)
        wrong = {
            joint: f"{sensor.removeprefix(joint).strip()}: {kind}"
            for joint, sensor, kind, dangerous in told
            if dangerous
        }
        before = nanoseconds(message.header.stamp) < self._begun
        self.loop.supervisor.encoders_found_faulty(wrong, before)
        self.tell()

    def _commanders(self) -> int:
        return self._commands.get_publisher_count() if self._commands else 0

    def _drive(self, frames: Sequence[Frame]) -> None:
        """Send valve frames, and tell what they open: limits may leave less than was commanded."""
        if frames:
            self._send(frames)
            self._outputs.publish(valve_output(self._stamp(), self.loop.supervisor.sent))

    def _send(self, frames: Sequence[Frame]) -> None:
        try:
            self._write(frames)
        except BusError as error:
            fault = Fault(FaultKind.BUS, str(error))
            self.loop.supervisor.can_faults([fault], self._now())

    def _write(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.link.send(frame)

    async def settled(self) -> None:
        """Wait until the driver may be enabled or reset: in real time, at once."""

    # Requests of services; `RefusedError` if the state does not permit one

    def enable(self) -> None:
        self.loop.supervisor.published_by(self._commanders())
        self.loop.supervisor.enable(self._now())

    def disable(self) -> None:
        self.loop.supervisor.disable()

    def emergency_stop(self) -> None:
        self.loop.supervisor.emergency_stop()
        self._send(self.loop.codec.neutral_frames())

    def reset_fault(self) -> None:
        self.loop.supervisor.reset(self._now())

    def substitute(self, joint: str) -> str:
        """Go on without the encoder of a joint; what holds now."""
        self.loop.supervisor.substitute(joint)
        if self._estimates:
            self._node.destroy_subscription(self._estimates)
            self._estimates = None
        if not joint:
            return "all encoders are in use; call reset_fault and enable"
        self._estimates = self._node.create_subscription(
            PositionEstimate, "position_estimate", self._estimated, COMMAND_DEPTH
        )
        return f"{joint} now uses position_estimate; call reset_fault and enable"

    def tell(self) -> None:
        entries = self.loop.supervisor.log
        for level, text in entries:
            match level:  # rclpy wants each line of code to keep to one level
                case Level.DEBUG:
                    self._log.debug(text)
                case Level.INFO:
                    self._log.info(text)
                case Level.WARNING:
                    self._log.warning(text)
                case Level.ERROR:
                    self._log.error(text)
        if entries:
            self._report()  # at once: who commands the valves waits for no second
        entries.clear()
