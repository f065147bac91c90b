"""`ros2 run crane_trajectory trajectory`: leads the crane through an excitation trajectory.

Every joint state that arrives is answered at once by a reference and a valve command: so the
driver paces the loop, at the rate of its encoders, and no time is lost between the two. A timer of
the steady clock watches that joint states arrive.

Software is no safety stop: keep the emergency stop of the machine within reach.
"""

import time
from collections.abc import Callable, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState

from crane_driver.nodes.managed import run_managed
from crane_driver.nodes.parameters import declare
from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import JointReference, ValveCommand
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine import JOINTS, Machine, load_machine
from crane_trajectory.check import Clearance, load_clearance
from crane_trajectory.controller import command
from crane_trajectory.experiment import Experiment, Outcome, at_rest
from crane_trajectory.motion import Motion, plan
from crane_trajectory.periodic import PeriodicTrajectory, load_trajectory
from crane_trajectory.trajectory_condition import status
from crane_trajectory.trajectory_parameters import (
    CHANGEABLE,
    CLEARANCE,
    FIXED,
    MACHINE,
    STATES_TIMEOUT,
    current_values,
    tuning,
)
from crane_trajectory.trajectory_topics import (
    ENABLED,
    Sample,
    command_message,
    driver_state,
    feedback_message,
    reference_message,
    result_message,
    sample,
)
from crane_trajectory.tuning import Tuning

WATCH = 0.01  # s
REPORT = 1.0  # s
FEEDBACK = 0.1  # s
PATIENCE = 2.0  # s for what a goal needs: driver enabled, joint states, crane at rest
RESTED = 0.2  # s without motion before an experiment
FORGET = 2.5  # s after which the driver's state is not known any more; it tells it every second
POLL = 0.001  # s
NEWEST = QoSProfile(depth=1)
DEPTH = 10
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class NotReadyError(CraneError):
    """A goal cannot begin: the driver is not enabled, joint states do not come, the crane moves."""


class Trajectory(LifecycleNode):
    """The action server; all of it runs in the thread of the executor."""

    def __init__(self) -> None:
        super().__init__("trajectory")
        declare(self, (*FIXED, *CHANGEABLE))
        self._lifecycle = "unconfigured"
        self._machine: Machine | None = None
        self._clearance: Clearance | None = None
        self._tuning: Tuning | None = None
        self._timeout = STATES_TIMEOUT.default
        self._states: Subscription | None = None
        self._newest: tuple[Sample, float] | None = None  # and when it came, steady clock
        self._resting_since: float | None = None
        self._driver = ("unknown", -np.inf)  # its state, and when it told
        self._busy = False  # with a goal
        self._experiment: Experiment | None = None
        self._valves: Publisher | None = None  # while an experiment runs: one may command them
        self._last = "none"
        self._next_watch = Future()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._references = self.create_publisher(JointReference, "/joint_reference", DEPTH)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", DEPTH)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, DEPTH)
        self.create_timer(WATCH, self._watch, clock=steady)
        self.create_timer(REPORT, self._report, clock=steady)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._server = ActionServer(
            self,
            RunExcitation,
            "run_excitation",
            self._execute,
            goal_callback=lambda _: GoalResponse.ACCEPT,  # what is refused is told in the result
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    # life cycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and files."""
        try:
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
        self._newest = self._resting_since = None
        self._states = self.create_subscription(JointState, "/joint_states", self._state, NEWEST)
        self._lifecycle = "active"
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
            time.sleep(POLL)
        self._close_valves()
        if self._states is not None:
            self.destroy_subscription(self._states)
            self._states = None

    # control

    def _state(self, message: JointState) -> None:
        now = time.monotonic()
        try:
            measured = sample(message)
        except DataError as error:
            self.get_logger().error(str(error), throttle_duration_sec=REPORT)
            return
        self._newest = measured, now
        assert self._tuning
        if not at_rest(measured.velocity, self._tuning):
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = now
        experiment = self._experiment
        if experiment is None:
            return
        self._send(experiment.sample(measured.seconds, measured.position, measured.velocity, now))
        if experiment.target is not None:
            self._references.publish(reference_message(experiment.target, measured.stamp))

    def _watch(self) -> None:
        now = time.monotonic()
        if self._experiment is not None:
            if self._driver[0] != ENABLED:
                self._experiment.release(
                    Outcome.DRIVER_FAULT,
                    f"the driver is not enabled any more; its state is {self._driver[0]}",
                    now,
                )
            self._send(self._experiment.watch(now))
        woken, self._next_watch = self._next_watch, Future(executor=self.executor)
        woken.set_result(None)

    def _send(self, u: np.ndarray | None) -> None:
        if u is not None and self._valves is not None:
            self._valves.publish(command_message(u, self.get_clock().now().to_msg()))

    # goals

    async def _execute(self, goal: ServerGoalHandle) -> RunExcitation.Result:
        if self._busy:
            return self._ended(goal, Outcome.NOT_READY, "another goal runs; cancel it first")
        self._busy = True
        try:
            return await self._run(goal)
        except NotReadyError as error:
            return self._ended(goal, Outcome.NOT_READY, str(error))
        except CraneError as error:
            return self._ended(goal, Outcome.TRAJECTORY_REFUSED, str(error))
        finally:
            self._close_valves()
            self._experiment, self._busy = None, False

    async def _run(self, goal: ServerGoalHandle) -> RunExcitation.Result:
        trajectory = load_trajectory(goal.request.trajectory)
        if goal.request.periods < 1:
            raise ConfigurationError("periods: must be at least 1, got 0")
        if not await self._until(goal, self._unready):
            return self._ended(goal, Outcome.CANCELED, "canceled, nothing has moved")
        motion = self._plan(trajectory, goal.request.periods)
        valves = self._valves = self.create_publisher(ValveCommand, "/valve_command", DEPTH)
        if not await self._until(goal, lambda: self._unready() or unheard(valves)):
            return self._ended(goal, Outcome.CANCELED, "canceled, nothing has moved")
        self.get_logger().info(
            f"{trajectory.name}: {motion.periods} periods, {motion.duration:.1f} s from now to rest"
        )
        assert self._tuning
        experiment = Experiment(motion, self._tuning, self._timeout, time.monotonic())
        self._experiment = experiment
        told = -np.inf
        while not experiment.over:
            await self._next_watch
            if goal.is_cancel_requested:
                experiment.stop(Outcome.CANCELED, "canceled, the crane is at rest")
            if (now := time.monotonic()) - told >= FEEDBACK:
                told = now
                goal.publish_feedback(feedback_message(experiment))
        return self._ended(goal, experiment.outcome, experiment.message, experiment.rms)

    def _plan(self, trajectory: PeriodicTrajectory, periods: int) -> Motion:
        assert self._machine and self._clearance and self._newest
        start = self._newest[0].position
        return plan(self._machine, trajectory, start, periods, self._clearance)

    async def _until(self, goal: ServerGoalHandle, lacking: Callable[[], str]) -> bool:
        """Wait until nothing is lacking; False if canceled, `NotReadyError` if it takes long."""
        deadline = time.monotonic() + PATIENCE
        while lack := lacking():
            if goal.is_cancel_requested:
                return False
            if time.monotonic() > deadline or self._lifecycle != "active":
                raise NotReadyError(f"not ready: {lack}; nothing has moved")
            await self._next_watch
        return True

    def _unready(self) -> str:
        """What is in the way of an experiment; empty if nothing is."""
        now = time.monotonic()
        if self._lifecycle != "active":
            return f"the node is {self._lifecycle}; activate it"
        others = self.get_publishers_info_by_topic("/valve_command")
        names = {one.node_name for one in others} - {self.get_name()}
        if names:
            return f"{', '.join(sorted(names))} may command the valves, only one may; stop it"
        if self._newest is None or now - self._newest[1] > self._timeout:
            return "no joint states come; start the driver and see its /diagnostics"
        if self._resting_since is None or now - self._resting_since < RESTED:
            return "the crane is not at rest; bring it to rest"
        state, told = self._driver
        if now - told > FORGET:
            return "the driver does not tell its state; start it"
        if state != ENABLED:
            return f"the driver is not enabled, its state is {state}; call /driver/enable"
        return ""

    def _ended(
        self,
        goal: ServerGoalHandle,
        outcome: Outcome,
        message: str,
        rms: np.ndarray | None = None,
    ) -> RunExcitation.Result:
        self._last = f"{outcome.name}: {message}"
        self.get_logger().info(self._last)
        if outcome is Outcome.COMPLETED:
            goal.succeed()
        elif outcome is Outcome.CANCELED:
            goal.canceled()
        else:
            goal.abort()
        return result_message(outcome, message, rms)

    def _close_valves(self) -> None:
        if self._valves is not None:
            self.destroy_publisher(self._valves)
            self._valves = None

    # parameters and reports

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        given = {one.name: one.value for one in parameters}
        fixed = [one.name for one in FIXED if one.name in given]
        if fixed and self._lifecycle != "unconfigured":
            return SetParametersResult(
                successful=False,
                reason=f"parameter '{fixed[0]}' is read when the node is configured, and the node "
                f"is {self._lifecycle}; deactivate it and clean it up first",
            )
        try:
            tuning(current_values(self) | given)
        except CraneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, _: list[Parameter]) -> None:
        if self._lifecycle == "unconfigured":
            return
        self._tuning = tuning(current_values(self))
        if self._experiment is not None:
            self._experiment.retune(self._tuning)

    def _diagnosed(self, message: DiagnosticArray) -> None:
        if (state := driver_state(message)) is not None:
            self._driver = state, time.monotonic()

    def _report(self) -> None:
        found = status(
            self.get_name(), self._lifecycle, self._experiment, self._last, self._driver[0]
        )
        message = DiagnosticArray(status=[found])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def unheard(valves: Publisher) -> str:
    """Empty once the driver listens."""
    return "" if valves.get_subscription_count() else "no driver listens to /valve_command"


ABOUT = """Leads the crane through excitation trajectories, as goals of the action
/run_excitation ask. Software is no safety stop."""


def main(argv: Sequence[str] | None = None) -> int:
    """Lead the crane through excitation trajectories, as goals of RunExcitation ask."""
    return run_managed("trajectory", Trajectory, ABOUT, (*FIXED, *CHANGEABLE), argv)
