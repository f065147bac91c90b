"""`ros2 run crane_trajectory trajectory`: leads the crane through an excitation trajectory.

Every joint state that arrives is answered at once by a reference and a valve command: so the
driver paces the loop, at the rate of its encoders, and no time is lost between the two. A timer of
the steady clock watches that joint states arrive.

Software is no safety stop: keep the emergency stop of the machine within reach.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState

from crane_interfaces.msg import DriverState, JointReference, ValveCommand
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine import JOINTS, Machine, load_machine
from crane_nodes.driver_client import DriverClient
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.names import full_name
from crane_nodes.parameters import declare, given, hold
from crane_nodes.publishers import publishers
from crane_nodes.ready import say_ready
from crane_trajectory.control.controller import command, load_gains
from crane_trajectory.control.tuning import Tuning
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion.check import Clearance, load_clearance
from crane_trajectory.motion.motion import Motion, plan
from crane_trajectory.motion.periodic import PeriodicTrajectory
from crane_trajectory.readiness import Readiness
from crane_trajectory.run_excitation_action import ACTION, Goals, NotReadyError
from crane_trajectory.trajectory_condition import status
from crane_trajectory.trajectory_parameters import (
    CHANGEABLE,
    CLEARANCE,
    CONTROLLER,
    FIXED,
    MACHINE,
    SINGLE_GAINS,
    STATES_TIMEOUT,
    current_values,
    tuning,
    values_of,
)
from crane_trajectory.trajectory_topics import (
    command_message,
    reference_message,
    sample,
)

WATCH_PERIOD_S = 0.01
REPORT_PERIOD_S = 1.0
POLL_PERIOD_S = 0.001
NEWEST = QoSProfile(depth=1)
DEPTH = 10
GAIN_NAMES = {one.name for one in SINGLE_GAINS}
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Trajectory(LifecycleNode):
    """Leads the crane as the goals of run_excitation ask; all in the thread of the executor."""

    def __init__(self) -> None:
        super().__init__("trajectory")
        self._single_gains = given(self, SINGLE_GAINS)  # no file changes these
        declare(self, (*FIXED, *CHANGEABLE), read_only=(AUTOSTART,))
        self._lifecycle = "unconfigured"
        hold(self, FIXED, lambda: self._lifecycle)
        self._machine: Machine | None = None
        self._clearance: Clearance | None = None
        self._tuning: Tuning | None = None
        self._timeout = STATES_TIMEOUT.default
        self._states: Subscription | None = None
        self._ready = Readiness()
        self._experiment: Experiment | None = None
        self._valves: Publisher | None = None  # while an experiment runs: one may command them
        self._next_watch = Future()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._references = self.create_publisher(JointReference, "joint_reference", DEPTH)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", DEPTH)
        self._driver = DriverClient(self)
        self.create_timer(WATCH_PERIOD_S, self._watch, clock=steady)
        self.create_timer(REPORT_PERIOD_S, self._report, clock=steady)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._goals = Goals(self, leader=self)

    # life cycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and files."""
        try:
            self._read_gains()
            self._tuning = tuning(current_values(self))
            self._timeout = STATES_TIMEOUT.read(self)
            self._machine = load_machine(MACHINE.read(self) or None)
            self._clearance = load_clearance(CLEARANCE.read(self) or None)
        except CraneError as error:
            for line in str(error).splitlines():
                self.get_logger().error(line)
            return FAILURE
        command(self._tuning.gains, *np.zeros((4, len(JOINTS))))  # compiled now, not while moving
        self._lifecycle = "inactive"
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen to the joint states; nothing moves before a goal."""
        self._ready.forget_states()
        self._states = self.create_subscription(JointState, "joint_states", self._state, NEWEST)
        self._lifecycle = "active"
        say_ready(self, ACTION)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the crane to rest first."""
        self._end("the node was deactivated")
        self._lifecycle = "inactive"
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget what was read."""
        self._machine = self._clearance = self._tuning = None
        self._lifecycle = "unconfigured"
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the crane to rest first."""
        self._end("the node was shut down")
        self._lifecycle = "finalized"
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """An error in a transition: bring the crane to rest, back to unconfigured."""
        self._end("an error in a transition of the node")
        return self.on_cleanup(state)

    def _end(self, why: str) -> None:
        """Come to rest within this call, taking joint states here: the executor waits for it."""
        if self._experiment is not None:
            self._experiment.stop(Outcome.DEACTIVATED, f"{why}, the crane is at rest")
        while self._experiment is not None and not self._experiment.over:
            assert self._states
            with self._states.handle:
                taken = self._states.handle.take_message(JointState, False)
            if taken is not None:
                self._state(taken[0])
            self._watch()
            time.sleep(POLL_PERIOD_S)
        self.close_valves()
        if self._states is not None:
            self.destroy_subscription(self._states)
            self._states = None

    # control

    def _state(self, message: JointState) -> None:
        now = time.monotonic()
        try:
            measured = sample(message)
        except DataError as error:
            self.get_logger().error(str(error), throttle_duration_sec=REPORT_PERIOD_S)
            return
        assert self._tuning
        self._ready.sample(measured.position, measured.velocity, self._tuning, now)
        experiment = self._experiment
        if experiment is None:
            return
        self._send(experiment.sample(measured.seconds, measured.position, measured.velocity, now))
        if experiment.target is not None:
            self._references.publish(reference_message(experiment.target, measured.stamp))

    def _watch(self) -> None:
        now = time.monotonic()
        if self._experiment is not None:
            told = self._driver.newest  # a silent one sends no joint states either
            if told.state != DriverState.STATE_ENABLED:
                why = f"{told.cause}; {told.remedy}"
                self._experiment.release(Outcome.DRIVER_FAULT, why, now)
            if several := self._several_states():
                self._experiment.release(Outcome.STATES_LOST, several, now)
            self._send(self._experiment.watch(now))
        woken, self._next_watch = self._next_watch, Future(executor=self.executor)
        woken.set_result(None)

    def _several_states(self) -> str:
        """Who publishes joint states, if not the driver alone, as a player of bags would."""
        if self.count_publishers("joint_states") < 2:
            return ""
        names, topic = publishers(self, "joint_states"), self.resolve_topic_name("joint_states")
        return f"{', '.join(names)} publish {topic}, only the driver may; stop the others"

    def _send(self, u: np.ndarray | None) -> None:
        if u is not None and self._valves is not None:
            self._valves.publish(command_message(u, self.get_clock().now().to_msg()))

    # what goals ask

    @property
    def active(self) -> bool:
        """Whether the node is."""
        return self._lifecycle == "active"

    @property
    def next_watch(self) -> Future:
        """Done when the experiment has been looked at again."""
        return self._next_watch

    def lacking(self) -> str:
        """What is in the way of an experiment; empty if nothing is."""
        if not self.active:
            return f"the node is {self._lifecycle}; activate it"
        others = [one for one in publishers(self, "valve_command") if one != full_name(self)]
        if others:
            return f"{', '.join(others)} may command the valves, only one may; stop it"
        if several := self._several_states():
            return several
        if lack := self._ready.lacking(self._timeout, time.monotonic()):
            return lack
        if problem := self._driver.problem:
            return problem
        if self._valves is not None and not self._valves.get_subscription_count():
            return f"no driver listens to {self._valves.topic_name}"
        return ""

    def planner(self, trajectory: PeriodicTrajectory, periods: int) -> Callable[[], Motion]:
        """What plans the motion from where the crane is now, in any thread."""
        start = self._ready.position
        assert self._machine and self._clearance and start is not None
        return partial(plan, self._machine, trajectory, start, periods, self._clearance)

    def open_valves(self) -> None:
        """Be the one who commands the valves."""
        self._valves = self.create_publisher(ValveCommand, "valve_command", DEPTH)

    def close_valves(self) -> None:
        """Command the valves no more."""
        if self._valves is not None:
            self.destroy_publisher(self._valves)
            self._valves = None

    def lead(self, motion: Motion) -> Experiment:
        """Begin to lead the crane; `NotReadyError` if it is not where the motion starts."""
        assert self._tuning and self._ready.position is not None
        moved = np.abs(self._ready.position - motion.start)
        if (moved > self._tuning.tolerance / 2).any():
            raise NotReadyError(
                "not ready: the crane was moved while its motion was planned; send the goal again"
            )
        self._experiment = Experiment(motion, self._tuning, self._timeout, time.monotonic())
        return self._experiment

    def end(self) -> None:
        """The experiment has ended, or has not begun."""
        self.close_valves()
        self._experiment = None

    # parameters and reports

    def _read_gains(self) -> None:
        """Gains of the controller file become the parameters that were not given by themselves."""
        file = CONTROLLER.read(self)
        read = {
            name: value
            for name, value in values_of(load_gains(file or None)).items()
            if name not in self._single_gains
        }
        result = self.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in read.items()]
        )
        self._single_gains -= read.keys()  # it was no user who set them
        if not result.successful:
            raise ConfigurationError(f"{file}: {result.reason}" if file else result.reason)

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        given = {one.name: one.value for one in parameters}
        try:
            tuning(current_values(self) | given)
        except CraneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        self._single_gains |= {one.name for one in parameters} & GAIN_NAMES
        if self._lifecycle == "unconfigured":
            return
        self._tuning = tuning(current_values(self))
        if self._experiment is not None:
            self._experiment.retune(self._tuning)

    def _report(self) -> None:
        driver = self._driver.state.text
        found = status(self.get_name(), self._lifecycle, self._experiment, self._goals.last, driver)
        message = DiagnosticArray(status=[found])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


ABOUT = """Leads the crane through excitation trajectories, as goals of the action
run_excitation ask. Software is no safety stop."""


def main(argv: Sequence[str] | None = None) -> int:
    """Lead the crane through excitation trajectories, as goals of RunExcitation ask."""
    return run_managed("trajectory", Trajectory, ABOUT, (*FIXED, *CHANGEABLE), argv)
