"""`ros2 run crane_driver driver`: the crane's CAN bus as topics, and safe commands to its valves.

Software is not a safety stop: keep the emergency stop of the machine within reach.
"""

import time
from collections.abc import Awaitable, Callable, Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from crane_bags.clocks import NANOSECONDS
from crane_driver import constants
from crane_driver.active_driver import ActiveDriver
from crane_driver.can.binding import load_layout
from crane_driver.can.bus import check_private
from crane_driver.can.frame import START_NS, TIME
from crane_driver.can.link import Link
from crane_driver.driver_loop import DriverLoop
from crane_driver.driver_messages import (
    FINALIZED,
    diagnostics,
    driver_state,
    inactive,
    inactive_state,
)
from crane_driver.driver_parameters import DriverParameters, driver_parameters, read_parameters
from crane_driver.lock_step import LockStepDriver
from crane_driver.safety.commands import RefusedError, load_safety
from crane_interfaces.msg import CylinderPressures, DriverState, ValveCommand
from crane_interfaces.srv import SubstituteEncoder
from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine import load_machine
from crane_model.machine_files import DEFAULT_MACHINE
from crane_model.urdf import urdf
from crane_nodes.driver_client import LATCHED, STATE_TOPIC
from crane_nodes.managed import AUTOSTART, full_name, run_managed, say_ready
from crane_nodes.node_time import NodeTime
from crane_nodes.parameters import MACHINE, declare, declare_machine, hold, read_machine_again

DIAGNOSTICS_DEPTH = 10  # messages
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE

ABOUT_DRIVER = """The crane's CAN bus as topics, and safe commands to its valves. They stay neutral
until the service ~/enable is called. Software is not a safety stop."""


class Driver(LifecycleNode):
    """Its life: parameters, services and reports; `ActiveDriver` does the work."""

    def __init__(self) -> None:
        super().__init__("driver")
        self._machine = declare_machine(self)
        _, *others = parameters = driver_parameters(self._machine, MACHINE.read(self))
        declare(self, others, read_only=(AUTOSTART,))
        self._settings: DriverParameters | None = None
        self._active: ActiveDriver | None = None
        self._lifecycle = "unconfigured"
        hold(self, parameters, lambda: self._lifecycle)
        self._time = NodeTime(self)
        depth = self._time.depth
        self._joints = self.create_publisher(JointState, "joint_states", depth)
        self._pressures = self.create_publisher(CylinderPressures, "cylinder_pressures", depth)
        self._outputs = self.create_publisher(ValveCommand, "valve_output", depth)
        self._diagnostics = self.create_publisher(
            DiagnosticArray, "/diagnostics", DIAGNOSTICS_DEPTH
        )
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        self._state = self.create_publisher(DriverState, STATE_TOPIC, LATCHED)
        self._received = self.create_guard_condition(self._receive)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(constants.REPORT_PERIOD_S, self._report, clock=steady)
        for name, action, waits in (
            ("enable", ActiveDriver.enable, True),
            ("disable", ActiveDriver.disable, False),
            ("emergency_stop", ActiveDriver.emergency_stop, False),
            ("reset_fault", ActiveDriver.reset_fault, True),
        ):
            self.create_service(Trigger, f"~/{name}", self._service(name, action, waits))
        self.create_service(SubstituteEncoder, "~/substitute", self._substitute)
        self._report()

    def stop(self) -> None:
        if active := self._active:
            self._active = None
            active.end()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and files, and check that they fit together."""
        try:
            self._machine = read_machine_again(self, self._machine)
            self._settings = read_parameters(self, self._machine)
            if self._time.simulated:
                check_private(self._settings.bus)
                if self._settings.listen_only:
                    raise ConfigurationError(
                        "listen_only and use_sim_time are both true; on simulated time the driver "
                        "sends the steps of the simulated crane: set one of them to false"
                    )
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
            ends = frozenset({TIME}) if self._time.simulated else loop.frames_of_cycle
            link = Link(
                self._settings.bus,
                self._received.trigger,
                cycle=ends,
                listen_only=self._settings.listen_only,
            ).open()
        except CraneError as error:
            return self._failed(error)
        topics = self._joints, self._pressures, self._outputs
        if self._time.simulated:
            self._active = LockStepDriver(
                self._time, self._settings.listeners, self, loop, link, *topics, self._report
            )
        else:
            self._active = ActiveDriver(self, loop, link, *topics, self._report)
        self._active.begin(self._settings.realtime)
        self.get_logger().info(f"CAN bus {self._settings.bus} is open; joints: {loop.joints}")
        self._lifecycle = "active"
        say_ready(self)
        self._report()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.stop()
        self._lifecycle = "inactive"
        self._report()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._settings = None
        self._lifecycle = "unconfigured"
        self._report()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.stop()
        self._lifecycle = FINALIZED
        self._report()
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.stop()
        return self.on_cleanup(state)

    def _new_loop(self) -> DriverLoop:
        assert self._settings
        listen_only = self._settings.listen_only
        return DriverLoop(
            load_layout(self._machine, self._settings.mapping, self._settings.dbc, listen_only),
            self._machine,
            load_safety(self._settings.safety, self._machine),
            self._settings.jerk_density,
            START_NS / NANOSECONDS if self._time.simulated else time.monotonic(),
            listen_only,
        )

    def _receive(self) -> None:
        if self._active:
            self._active.receive()

    def _report(self) -> None:
        if self._active:
            state = driver_state(self._active.loop.supervisor)
            status = diagnostics(full_name(self), self._active.loop, self._active.link)
        else:
            state = inactive_state(self._lifecycle)
            status = [inactive(full_name(self), self._lifecycle)]
        now = self._time.stamp()
        state.node = self.get_fully_qualified_name()
        state.header.stamp = now
        self._state.publish(state)
        message = DiagnosticArray(status=status)
        message.header.stamp = now
        self._diagnostics.publish(message)

    def _service(
        self, name: str, action: Callable[[ActiveDriver], None], waits: bool
    ) -> Callable[[Trigger.Request, Trigger.Response], Awaitable[Trigger.Response]]:
        async def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            if waits and self._active:
                await self._active.settled()

            def asked(active: ActiveDriver) -> str:
                action(active)
                return active.loop.supervisor.state

            response.success, response.message = self._ask(name, asked)
            return response

        return answer

    def _substitute(
        self, request: SubstituteEncoder.Request, response: SubstituteEncoder.Response
    ) -> SubstituteEncoder.Response:
        response.success, response.message = self._ask(
            "substitute", lambda active: active.substitute(request.joint)
        )
        return response

    def _ask(self, name: str, action: Callable[[ActiveDriver], str]) -> tuple[bool, str]:
        """Return whether it was done, and what the answer to a service says."""
        if self._active is None:
            return False, f"{name}: the driver is {self._lifecycle}; activate it first"
        success = True
        try:
            said = action(self._active)
        except RefusedError as error:
            success, said = False, str(error)
            self.get_logger().warning(said)
        self._active.tell()
        return success, said

    def _failed(self, error: CraneError) -> TransitionCallbackReturn:
        for line in str(error).splitlines():
            self.get_logger().error(line)
        return FAILURE


def main(argv: Sequence[str] | None = None) -> int:
    """Run the driver until a signal ends it; it ramps to neutral before it ends."""
    parameters = driver_parameters(load_machine(), DEFAULT_MACHINE)
    return run_managed("driver", Driver, ABOUT_DRIVER, parameters, argv)
