"""`ros2 run crane_driver driver`: the crane's CAN bus as topics, and safe commands to its valves.

Software is no safety stop: keep the emergency stop of the machine within reach.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusError
from crane_driver.can.frame import Frame
from crane_driver.can.link import Link
from crane_driver.driver_loop import DriverLoop
from crane_driver.driver_messages import (
    FINALIZED,
    cylinder_pressures,
    diagnostics,
    driver_state,
    inactive,
    inactive_state,
    joint_state,
)
from crane_driver.driver_parameters import PARAMETERS, DriverParameters, read_parameters
from crane_driver.faults import Fault, FaultKind
from crane_driver.realtime import RealTime
from crane_driver.safety.news import Level
from crane_driver.safety.settings import load_safety
from crane_driver.safety.supervisor import RefusedError
from crane_interfaces.msg import CylinderPressures, DriverState, ValveCommand
from crane_model.errors import CraneError
from crane_model.machine import Machine, load_machine
from crane_model.urdf import urdf
from crane_nodes.driver_client import LATCHED, STATE_TOPIC
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.names import full_name
from crane_nodes.parameters import declare, hold
from crane_nodes.ready import say_ready

REPORT_PERIOD_S = 1.0
DEPTH = 10  # messages
FRAMES_AT_ONCE = 200  # frames at once: a flood must not keep the valves waiting for their frames
OLDEST_COMMAND_S = 1.0  # a greater age is that of another clock
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Driver(LifecycleNode):
    """Everything but the receiving of frames happens in the thread of the executor."""

    def __init__(self) -> None:
        super().__init__("driver")
        declare(self, PARAMETERS, read_only=(AUTOSTART,))
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._loop: DriverLoop | None = None
        self._link: Link | None = None
        self._settings: DriverParameters | None = None
        self._machine: Machine | None = None
        self._realtime: RealTime | None = None
        self._commanders: Callable[[], int] = lambda: 0
        self._active: list[Callable[[], Any]] = []  # what ends with the active state
        self._lifecycle = "unconfigured"
        hold(self, PARAMETERS, lambda: self._lifecycle)
        self._joints = self.create_publisher(JointState, "joint_states", DEPTH)
        self._pressures = self.create_publisher(CylinderPressures, "cylinder_pressures", DEPTH)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", DEPTH)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        self._state = self.create_publisher(DriverState, STATE_TOPIC, LATCHED)
        self._received = self.create_guard_condition(self._receive)
        self.create_timer(REPORT_PERIOD_S, self._report, clock=self._steady)
        for name, action in (
            ("enable", self._enable),
            ("disable", self._disable),
            ("emergency_stop", self._emergency_stop),
            ("reset_fault", self._reset),
        ):
            self.create_service(Trigger, f"~/{name}", self._service(name, action))
        self._report()

    def stop(self) -> None:
        """Ramp to neutral and close the bus."""
        if self._loop is None or self._link is None:
            return
        for end in self._active:
            end()
        self._active.clear()
        loop, link, self._loop, self._link = self._loop, self._link, None, None
        loop.supervisor.disable()
        moving = True
        while moving:
            now = time.monotonic()
            output = loop.supervisor.output(now)
            moving = output.enabled
            self._send(link, loop.codec.command_frames(output.commands, output.enabled))
            time.sleep(loop.cycle)
        link.close()
        if self._realtime:
            self._realtime.end()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and files, and check that they fit together."""
        try:
            self._settings = read_parameters(self)
            self._machine = load_machine(self._settings.machine)
            self._new_loop()
        except CraneError as error:
            return self._failed(error)
        self._description.publish(String(data=urdf(self._machine)))
        self._lifecycle = "inactive"
        self._report()
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the bus and begin to publish; the crane stays disabled."""
        assert self._settings
        try:
            loop = self._new_loop()
            link = Link(self._settings.bus, self._received.trigger).open()
        except CraneError as error:
            return self._failed(error)
        self._loop, self._link = loop, link
        self._be_punctual()
        subscription = self.create_subscription(
            ValveCommand,
            "valve_command",
            self._command,  # type: ignore[arg-type]  # rclpy does not declare the second argument
            DEPTH,
        )
        self._commanders = subscription.get_publisher_count
        timer = self.create_timer(loop.cycle, self._cycle, clock=self._steady)
        self._active = [
            lambda: self.destroy_timer(timer),
            lambda: self.destroy_subscription(subscription),
        ]
        self.get_logger().info(f"CAN bus {self._settings.bus} is open; joints: {loop.joints}")
        self._lifecycle = "active"
        say_ready(self)
        self._report()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ramp to neutral and close the bus."""
        self.stop()
        self._lifecycle = "inactive"
        self._report()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the parameters; they are read again when the node is configured."""
        self._settings = self._machine = None
        self._lifecycle = "unconfigured"
        self._report()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ramp to neutral and close the bus."""
        self.stop()
        self._lifecycle = FINALIZED
        self._report()
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """An error in a transition: ramp to neutral, close the bus, back to unconfigured."""
        self.stop()
        return self.on_cleanup(state)

    def _new_loop(self) -> DriverLoop:
        assert self._settings and self._machine
        return DriverLoop(
            load_layout(self._settings.mapping, self._settings.dbc),
            self._machine,
            load_safety(self._settings.safety),
            self._settings.jerk_density,
            time.monotonic(),
        )

    def _be_punctual(self) -> None:
        """Once the threads are there that serve the bus."""
        assert self._settings
        self._realtime = realtime = RealTime(self._settings.realtime).begin()
        if realtime.obtained:
            self.get_logger().info(f"real time: {', '.join(realtime.obtained)}")
        if realtime.refused:
            self.get_logger().warning(
                f"real time: no {'; no '.join(realtime.refused)}. Beside other work the driver may "
                "stall: permit it (share/crane_driver/realtime), or do not ask for it (parameters "
                "realtime.*)"
            )

    def _receive(self) -> None:
        """Frames or faults of the bus wait to be taken."""
        if self._loop is None or self._link is None:
            return
        self._take(self._loop, self._link)
        self._send(self._link, self._loop.valve_frames(time.monotonic()))

    def _take(self, loop: DriverLoop, link: Link) -> None:
        loop.run(time.monotonic(), time.process_time())
        frames = link.take(FRAMES_AT_ONCE)
        joints, pressures = loop.receive(frames, link.take_faults(), time.monotonic())
        for pressure_sample in pressures:
            self._pressures.publish(cylinder_pressures(pressure_sample, loop.cylinders))
        for joint_sample in joints:
            self._joints.publish(joint_state(joint_sample, loop.joints))

    def _cycle(self) -> None:
        if self._loop is None or self._link is None:
            return
        self._take(self._loop, self._link)  # before it is judged what has not come
        now = time.monotonic()
        self._loop.check(self._commanders(), now, self._link.heard(now))
        self._send(self._link, self._loop.valve_frames(now))
        self._send(self._link, self._loop.device_frames(now))
        self._tell()

    def _command(self, message: ValveCommand, info: dict[str, Any]) -> None:
        if self._loop is None or self._link is None:
            return
        age = (time.time_ns() - info["received_timestamp"]) * 1e-9
        received = time.monotonic() - (age if 0.0 <= age < OLDEST_COMMAND_S else 0.0)
        self._loop.run(time.monotonic(), time.process_time())
        self._loop.supervisor.published_by(self._commanders())
        try:
            self._loop.supervisor.command(message.name, message.command, received)
        except RefusedError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=REPORT_PERIOD_S)
            return
        self._send(self._link, self._loop.valve_frames(time.monotonic(), commanded=True))

    def _send(self, link: Link, frames: Sequence[Frame]) -> None:
        try:
            for frame in frames:
                link.send(frame)
        except BusError as error:
            if self._loop:
                fault = Fault(FaultKind.BUS, str(error))
                self._loop.supervisor.can_faults([fault], time.monotonic())

    def _tell(self) -> None:
        assert self._loop
        news, log = self._loop.supervisor.news, self.get_logger()
        for level, text in news:
            match level:  # rclpy wants each line of code to keep to one level
                case Level.DEBUG:
                    log.debug(text)
                case Level.INFO:
                    log.info(text)
                case Level.WARNING:
                    log.warning(text)
                case Level.ERROR:
                    log.error(text)
        if news:
            self._report()  # at once: who commands the valves waits for no second
        news.clear()

    def _report(self) -> None:
        """State and diagnostics, once a second and at every change."""
        if self._loop and self._link:
            state = driver_state(self._loop.supervisor)
            status = diagnostics(full_name(self), self._loop, self._link)
        else:
            state = inactive_state(self._lifecycle)
            status = [inactive(full_name(self), self._lifecycle)]
        now = self.get_clock().now().to_msg()
        state.node = self.get_fully_qualified_name()
        state.header.stamp = now
        self._state.publish(state)
        message = DiagnosticArray(status=status)
        message.header.stamp = now
        self._diagnostics.publish(message)

    def _service(
        self, name: str, action: Callable[[DriverLoop], None]
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if self._loop is None:
                response.message = f"{name}: the driver is {self._lifecycle}; activate it first"
                return response
            try:
                action(self._loop)
            except RefusedError as error:
                response.message = str(error)
                self.get_logger().warning(str(error))
            else:
                response.success = True
                response.message = str(self._loop.supervisor.state)
            self._tell()
            return response

        return answer

    def _enable(self, loop: DriverLoop) -> None:
        loop.supervisor.published_by(self._commanders())
        loop.supervisor.enable(time.monotonic())

    @staticmethod
    def _disable(loop: DriverLoop) -> None:
        loop.supervisor.disable()

    def _emergency_stop(self, loop: DriverLoop) -> None:
        loop.supervisor.emergency_stop()
        assert self._link
        self._send(self._link, loop.codec.neutral_frames())

    @staticmethod
    def _reset(loop: DriverLoop) -> None:
        loop.supervisor.reset(time.monotonic())

    def _failed(self, error: CraneError) -> TransitionCallbackReturn:
        for line in str(error).splitlines():
            self.get_logger().error(line)
        return FAILURE


ABOUT = """The crane's CAN bus as topics, and safe commands to its valves. They stay neutral until
the service ~/enable is called. Software is no safety stop."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the driver until a signal ends it; it ramps to neutral before it ends."""
    return run_managed("driver", Driver, ABOUT, PARAMETERS, argv)
