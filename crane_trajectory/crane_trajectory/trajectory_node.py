"""`ros2 run crane_trajectory trajectory`: moves the crane along an excitation trajectory.

Every joint state that arrives is answered at once by a reference and a valve command: so the
driver paces the loop, at the rate of its encoders, and no time is lost between the two. A timer of
the steady clock watches that joint states arrive.

Software is not a safety stop: keep the emergency stop of the machine within reach.
"""

import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from crane_interfaces.msg import DriverState, JointReference
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine_files import machine_file
from crane_nodes.driver_client import DriverWatch
from crane_nodes.managed import AUTOSTART, full_name, run_managed, say_ready
from crane_nodes.node_time import NodeTime
from crane_nodes.parameters import MACHINE, declare, declare_machine, hold, read_machine_again
from crane_nodes.this_computer import RealTime, RealTimeSettings
from crane_trajectory.control.controller import Tuning, compile_command
from crane_trajectory.experiment import Experiment, Outcome, Readiness
from crane_trajectory.motion.check import Clearance, load_clearance
from crane_trajectory.motion.motion import Motion, compile_reference, plan
from crane_trajectory.motion.periodic import PeriodicTrajectory, read_apart
from crane_trajectory.run_excitation_action import (
    ACTION,
    Goals,
    JointTrajectories,
    NotReadyError,
    defect,
)
from crane_trajectory.trajectory_topics import (
    CLEARANCE,
    FIXED,
    LEARNT_OUTPUT,
    PRIORITY,
    STATES_TIMEOUT,
    Leading,
    TuningParameters,
    Valves,
    parameters_of,
    reference_message,
    sample,
    several_sources,
)

WATCH_PERIOD_S = 0.01
REPORT_PERIOD_S = 1.0
POLL_PERIOD_S = 0.001
STATES_DEPTH, REPORT_DEPTH = 1, 10  # messages


def condition(
    name: str,
    lifecycle: str,
    experiment: Experiment | None,
    last: str,
    driver: str,
    led: Mapping[str, str],
    stamp: Time,
) -> DiagnosticArray:
    """Status for /diagnostics: state, phase, tracking error and `last`, the end of the last
    experiment.

    `led`: inputs of the controller and its learnt values, in words.
    """
    found = DiagnosticStatus(name=f"{name}: experiment", level=DiagnosticStatus.OK)
    values = {"state": lifecycle, "driver": driver, "last result": last, "phase": "rest"}
    if experiment is None:
        found.message = f"{lifecycle}, no experiment runs"
        if lifecycle != "active":
            found.level = DiagnosticStatus.STALE
    else:
        phase = experiment.stage.name.lower()
        if experiment.target is not None:
            phase += f", {experiment.target.phase.name.lower()}"
        total = experiment.motion.duration
        found.message = f"{phase}, {experiment.elapsed:.1f} of {total:.1f} s"
        values["phase"] = phase
        values["controller"] = experiment.controlled
        units = experiment.motion.machine.units
        for (joint, unit), error in zip(units.items(), experiment.tracking_error, strict=True):
            values[f"tracking error, {joint} [{unit}]"] = f"{error:.4g}"
    values |= led
    found.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    message = DiagnosticArray(status=[found])
    message.header.stamp = stamp
    return message


class Trajectory(LifecycleNode):
    """Moves the crane as the goals of run_excitation ask; all in the thread of the executor."""

    def __init__(self) -> None:
        super().__init__("trajectory")
        self._machine = declare_machine(self)
        declare(self, (*FIXED, LEARNT_OUTPUT), read_only=(AUTOSTART,))
        self._tuning_parameters = TuningParameters(self, self._machine, changed=self._retune)
        self._realtime: RealTime | None = None
        self._lifecycle = "unconfigured"
        hold(self, FIXED, lambda: self._lifecycle)
        self._clearance: Clearance | None = None
        self._tuning: Tuning | None = None
        self._states: Subscription | None = None
        self._ready = Readiness()
        self._experiment: Experiment | None = None
        self._time = NodeTime(self)
        self._time.listen()
        self._leading = Leading(self, self._time)
        self._valves = Valves(self, self._time, self._machine.joint_names)
        self._next_watch = Future()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._references = self.create_publisher(
            JointReference, "joint_reference", self._time.depth
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", REPORT_DEPTH)
        self._driver = DriverWatch(self)
        self.create_service(Trigger, "~/save_learnt", self._save_learnt)
        self.create_timer(WATCH_PERIOD_S, self._watch, clock=steady)
        self.create_timer(REPORT_PERIOD_S, self._report, clock=steady)
        self._goals = Goals(self, self._time, leader=self, units=self._machine.units)
        self._asked: JointTrajectories | None = None

    # life cycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            self._machine = read_machine_again(self, self._machine)
            self._tuning_parameters.read_file(self._machine)
            self._tuning = self._tuning_parameters.read()
            self._leading.configure(self._machine, self._tuning.gains)
            self._tuning = self._leading.tightened(self._tuning)
            clearance = machine_file("clearance.yaml", MACHINE.read(self), CLEARANCE.read(self))
            self._clearance = load_clearance(clearance)
        except CraneError as error:
            for line in str(error).splitlines():
                self.get_logger().error(line)
            return TransitionCallbackReturn.FAILURE
        compile_command(self._tuning.gains)
        compile_reference(self._machine)
        self._lifecycle = "inactive"
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen to the joint states; nothing moves before a goal."""
        settings = RealTimeSettings(int(PRIORITY.read(self)), lock_memory=False)
        self._realtime = RealTime(settings).begin()  # all is compiled
        for refused in self._realtime.refused:
            self.get_logger().warning(f"real time: no {refused}")
        self._ready.forget_states()
        self._leading.listen()
        self._states = self.create_subscription(
            JointState, "joint_states", self._state, STATES_DEPTH
        )
        self._asked = JointTrajectories(self, self._time, self._goals, leader=self)
        self._lifecycle = "active"
        say_ready(self, ACTION)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring the crane to rest first."""
        self._end("the node was deactivated")
        if self._realtime:
            self._realtime.end()
        self._lifecycle = "inactive"
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._clearance = self._tuning = None
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
        self._valves.close()
        if self._states is not None:
            self.destroy_subscription(self._states)
            self._states = None
        if self._asked is not None:
            self._asked.close()
            self._asked = None
        self._leading.silence()

    # control

    def _state(self, message: JointState) -> None:
        now = self._time.of(message.header.stamp)
        try:
            measured = sample(message, self._machine.joint_names)
        except DataError as error:
            self.get_logger().error(str(error), throttle_duration_sec=REPORT_PERIOD_S)
            return
        position, velocity = measured.position, measured.velocity
        assert self._tuning
        self._ready.sample(position, velocity, self._tuning, now)
        if (experiment := self._experiment) is not None:
            with self._failing_softly(experiment, now):
                pressures = self._leading.sensed(measured.seconds)
                u = experiment.sample(measured.seconds, position, velocity, now, pressures)
                self._valves.send(u)
                if (target := experiment.target) is not None:
                    joints = self._machine.joint_names
                    self._references.publish(reference_message(target, measured.stamp, joints))

    def _watch(self) -> None:
        now = self._time.now()
        if (experiment := self._experiment) is not None:
            with self._failing_softly(experiment, now):
                told = self._driver.newest  # a silent one sends no joint states either
                if told.state != DriverState.STATE_ENABLED:
                    experiment.release(Outcome.DRIVER_FAULT, f"{told.cause}; {told.remedy}", now)
                if several := several_sources(self):
                    experiment.release(Outcome.STATES_LOST, several, now)
                self._valves.send(experiment.watch(now))
        woken, self._next_watch = self._next_watch, Future(executor=self.executor)
        woken.set_result(None)

    @contextmanager
    def _failing_softly(self, experiment: Experiment, now: float) -> Iterator[None]:
        """A defect within the `with` block ends the experiment, not the node."""
        try:
            yield
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            experiment.fail(defect(error), now)

    # Requests of goals

    @property
    def active(self) -> bool:
        return self._lifecycle == "active"

    @property
    def next_watch(self) -> Future:
        """Done when the experiment has been looked at again."""
        return self._next_watch

    def lacking(self) -> str:
        """Obstacle to an experiment; empty if there is none."""
        if not self.active:
            return f"the node is {self._lifecycle}; activate it"
        return (
            self._valves.rivals
            or several_sources(self)
            or self._ready.lacking(STATES_TIMEOUT.read(self), self._time.now())
            or self._driver.problem
            or self._valves.unheard
        )

    @property
    def position(self) -> Mapping[str, float]:
        """Positions of the joints [rad, m]; empty before the first joint state."""
        newest = self._ready.position
        if newest is None:
            return {}
        return dict(zip(self._machine.joint_names, newest.tolist(), strict=True))

    def read(self, trajectory: str) -> PeriodicTrajectory:
        """The trajectory of a path, or that of the machine which has the name."""
        try:
            file = machine_file("", MACHINE.read(self), trajectory)
        except OSError as error:  # such as a name longer than any
            raise ConfigurationError(f"trajectory: {error.strerror}: {trajectory}") from None
        return read_apart(file)

    def planner(self, trajectory: PeriodicTrajectory, periods: int) -> Callable[[], Motion]:
        """Planner of the motion from the present pose, in any thread."""
        start = self._ready.position
        assert self._clearance and start is not None
        return partial(plan, self._machine, trajectory, start, periods, self._clearance)

    def open_valves(self) -> None:
        self._valves.open()

    def lead(self, motion: Motion) -> Experiment:
        """Begin to move the crane; `NotReadyError` if it is not where the motion starts."""
        assert self._tuning
        if moved := self._ready.moved_from(motion.start, self._tuning, self._machine.units):
            raise NotReadyError(f"not ready: {moved}; send the goal again")
        self._experiment = Experiment(
            motion,
            self._tuning,
            STATES_TIMEOUT.read(self),
            self._time.now(),
            self._leading.leader(motion.trajectory),
        )
        self._valves.send(np.zeros(len(self._machine.joint_names)))  # simulated time waits for it
        return self._experiment

    def end(self) -> None:
        """The experiment has ended, or has not begun."""
        self._valves.close()
        self._experiment = None

    # parameters and reports

    def _retune(self) -> None:
        if self._lifecycle == "unconfigured":
            return
        self._tuning = self._leading.tightened(self._tuning_parameters.read())
        if self._experiment is not None:
            self._experiment.retune(self._tuning)

    def _report(self) -> None:
        last, driver = self._goals.last, self._driver.state.text
        now = self._time.stamp()
        led = self._leading.load | self._leading.learnt
        found = condition(
            full_name(self), self._lifecycle, self._experiment, last, driver, led, now
        )
        self._diagnostics.publish(found)

    def _save_learnt(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        file = Path(LEARNT_OUTPUT.read(self)).absolute()
        try:
            self._leading.save_learnt(file)
        except (CraneError, OSError) as error:
            response.message = str(error)
            return response
        response.success, response.message = True, f"wrote {file}; give it as model to go on"
        return response


ABOUT = """Moves the crane along excitation trajectories, as goals of the action
run_excitation ask. Software is not a safety stop."""


def main(argv: Sequence[str] | None = None) -> int:
    """Move the crane along excitation trajectories, as goals of RunExcitation ask."""
    return run_managed("trajectory", Trajectory, ABOUT, parameters_of(), argv)
