"""Motion requests, by action run_excitation or by topic, from request to result."""

import time
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Future as Result
from threading import Thread
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from crane_interfaces.action import RunExcitation
from crane_model.errors import ConfigurationError, CraneError
from crane_nodes.node_time import NodeTime
from crane_nodes.this_computer import PATIENCE_S, give_way
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion.motion import Motion
from crane_trajectory.motion.periodic import PeriodicTrajectory
from crane_trajectory.trajectory_topics import feedback_message, points_trajectory, result_message

ACTION = "run_excitation"
FEEDBACK_PERIOD_S = 0.1  # s
READINESS_TIMEOUT_S = 2.0  # for what a goal needs: driver enabled, joint states, crane at rest
LONGEST_MESSAGE = 10_000  # characters, of a result and of the log: fifty lines of two hundred

Made = TypeVar("Made")


class NotReadyError(CraneError):
    """A goal cannot begin: the driver is not enabled, joint states do not come, the crane moves."""


class UnexpectedError(CraneError):
    """A defect of the program, found while nothing has moved."""


class CanceledError(CraneError):
    """The goal was canceled before anything moved."""


def defect(error: Exception) -> str:
    """Message for an unforeseen error."""
    return (
        f"{type(error).__name__}: {error}. This is a defect of the program: report it, with the "
        "log of the node and the trajectory"
    )


def bounded(message: str) -> str:
    """A message whose middle is left out if it is too long; begin and end stay."""
    beyond = len(message) - LONGEST_MESSAGE
    if beyond <= 0:
        return message
    half = LONGEST_MESSAGE // 2
    return f"{message[:half]} ... ({beyond} characters left out) ... {message[-half:]}"


class Leader(Protocol):
    """Who controls the crane."""

    @property
    def active(self) -> bool:
        """Return whether goals may begin at all."""

    @property
    def next_watch(self) -> Future:
        """Done when the experiment has been looked at again."""

    def lacking(self) -> str:
        """Obstacle to an experiment; empty if there is none."""

    @property
    def position(self) -> Mapping[str, float]:
        """Positions of the joints [rad, m]; empty before the first joint state."""

    def read(self, trajectory: str) -> PeriodicTrajectory:
        """Read the trajectory of a goal, in any thread; `ConfigurationError` if it is wrong."""

    def planner(self, trajectory: PeriodicTrajectory, periods: int) -> Callable[[], Motion]:
        """Plan from the present pose, in any thread; `RangeError` if the crane may not go there."""

    def open_valves(self) -> None:
        """Be the one who commands the valves."""

    def lead(self, motion: Motion) -> Experiment:
        """Begin to move the crane; `NotReadyError` if it is not where the motion starts."""

    def end(self) -> None:
        """The experiment has ended, or has not begun."""


class MotionRequest(Protocol):
    """Requested motion, and its client."""

    periods: int

    def read(self) -> PeriodicTrajectory:
        """The trajectory, in any thread; `ConfigurationError` if it is wrong."""

    @property
    def canceled(self) -> str:
        """Why the crane is to come to rest; empty if it is not."""

    def feedback(self, experiment: Experiment) -> None:
        """Tell how far it has come."""


class Ended(NamedTuple):
    """How a request ended, with the RMS tracking error (j,) over whole periods, if any."""

    outcome: Outcome
    message: str
    rms: np.ndarray | None = None


class Goals:
    """Requests are carried out one at a time; `last` tells how the last one has ended."""

    def __init__(self, node: Node, clock: NodeTime, leader: Leader, units: Mapping[str, str]):
        """`units` of the joints of the machine, from the base to the tip: rad or m."""
        self.last = "none"
        self._clock = clock
        self._leader, self._units, self._log = leader, units, node.get_logger()
        self._busy = False
        self._server = ActionServer(
            node,
            RunExcitation,
            ACTION,
            self._execute,
            goal_callback=lambda _: GoalResponse.ACCEPT,  # what is refused is told in the result
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    async def _execute(self, goal: ServerGoalHandle) -> RunExcitation.Result:
        ended = await self.carry_out(_ActionGoal(goal, self._leader))
        if ended.outcome is Outcome.COMPLETED:
            goal.succeed()
        elif ended.outcome is Outcome.CANCELED:
            goal.canceled()
        else:
            goal.abort()
        return result_message(ended.outcome, ended.message, self._units, ended.rms)

    async def carry_out(self, request: MotionRequest) -> Ended:
        """Lead the crane as it is asked, if nothing is in the way."""
        ended = await self._carried_out(request)
        ended = ended._replace(message=bounded(ended.message))
        self.last = f"{ended.outcome.name}: {ended.message}"
        self._log.info(self.last)
        return ended

    async def _carried_out(self, request: MotionRequest) -> Ended:
        if self._busy:
            return Ended(Outcome.NOT_READY, "another goal runs; cancel it first")
        self._busy = True
        try:
            return await self._run(request)
        except CanceledError as error:
            return Ended(Outcome.CANCELED, str(error))
        except NotReadyError as error:
            return Ended(Outcome.NOT_READY, str(error))
        except UnexpectedError as error:
            return Ended(Outcome.FAILED, str(error))
        except CraneError as error:
            return Ended(Outcome.TRAJECTORY_REFUSED, str(error))
        except Exception as error:
            return Ended(Outcome.FAILED, self._told(error))
        finally:
            self._leader.end()
            self._busy = False

    async def _run(self, request: MotionRequest) -> Ended:
        if request.periods < 1:
            raise ConfigurationError("periods: must be at least 1, got 0")
        trajectory = await self._aside(request, request.read)
        await self._ready(request)
        planner = self._leader.planner(trajectory, request.periods)
        motion = await self._aside(request, planner)
        self._leader.open_valves()
        await self._ready(request)
        periods = f"{motion.periods} periods, " if motion.run_up else ""
        self._log.info(f"{trajectory.name}: {periods}{motion.duration:.1f} s from now to rest")
        experiment = self._leader.lead(motion)
        told = -np.inf
        while not experiment.over:
            await self._leader.next_watch
            real = time.monotonic()
            try:
                if why := request.canceled:
                    experiment.stop(Outcome.CANCELED, f"{why}, the crane is at rest")
                if real - told >= FEEDBACK_PERIOD_S:
                    told = real
                    request.feedback(experiment)
            except Exception as error:
                experiment.release(Outcome.FAILED, self._told(error), self._clock.now())
        return Ended(experiment.outcome, experiment.account, experiment.rms)

    def _told(self, error: Exception) -> str:
        """A defect in words, when the log has been told where it is."""
        self._log.error(traceback.format_exc())
        return defect(error)

    async def _aside(self, request: MotionRequest, work: Callable[[], Made]) -> Made:
        """Return the result of `work` while the executor goes on; `CanceledError` if canceled.

        The thread is then left to itself: a file may be on a disk that does not answer.
        """
        result: Result[Made] = Result()

        def run() -> None:
            give_way()
            try:
                result.set_result(work())
            except CraneError as error:
                result.set_exception(error)
            except Exception as error:
                result.set_exception(UnexpectedError(f"nothing has moved: {self._told(error)}"))

        Thread(target=run, daemon=True).start()
        while not result.done():
            await self._next_watch(request)
        return result.result()

    async def _ready(self, request: MotionRequest) -> None:
        """Wait until nothing is lacking; `NotReadyError` if it takes long, `CanceledError`."""
        begun, really = self._clock.now(), time.monotonic()
        while lack := self._leader.lacking():
            waited = self._clock.now() - begun > READINESS_TIMEOUT_S
            if waited or time.monotonic() - really > PATIENCE_S or not self._leader.active:
                raise NotReadyError(f"not ready: {lack}; nothing has moved")
            await self._next_watch(request)

    async def _next_watch(self, request: MotionRequest) -> None:
        """For as long as nothing moves."""
        if why := request.canceled:
            raise CanceledError(f"{why}, nothing has moved")
        await self._leader.next_watch


class _ActionGoal:
    def __init__(self, goal: ServerGoalHandle, leader: Leader):
        self._goal, self._leader = goal, leader
        self.periods: int = goal.request.periods

    def read(self) -> PeriodicTrajectory:
        return self._leader.read(self._goal.request.trajectory)

    @property
    def canceled(self) -> str:
        return "canceled" if self._goal.is_cancel_requested else ""

    def feedback(self, experiment: Experiment) -> None:
        self._goal.publish_feedback(feedback_message(experiment))


class JointTrajectories:
    """The topic `~/joint_trajectory`: each message is a motion, an empty one ends it.

    If its sender leaves the graph, the crane comes to rest along its path.
    """

    periods = 1

    def __init__(self, node: Node, clock: NodeTime, goals: Goals, leader: Leader):
        self._node, self._clock, self._goals, self._leader = node, clock, goals, leader
        self._message = JointTrajectory()
        self._running = self._ended = False
        self._topic = node.create_subscription(
            JointTrajectory,
            "~/joint_trajectory",
            self._take,  # type: ignore[arg-type]  # the executor goes on with coroutines
            QoSProfile(depth=10),
        )
        self._name = self._topic.topic_name

    def close(self) -> None:
        self._node.destroy_subscription(self._topic)

    async def _take(self, message: JointTrajectory) -> None:
        if not message.points:
            self._ended = True
        elif self._running:
            self._node.get_logger().warning("joint trajectory refused: another one runs; end it")
        else:
            self._message, self._running, self._ended = message, True, False
            try:
                await self._goals.carry_out(self)
            finally:
                self._running = False

    def read(self) -> PeriodicTrajectory:
        """The motion of the message, from where the crane is now."""
        position = self._leader.position
        if not position:
            raise NotReadyError("not ready: no joint state has come; nothing has moved")
        return points_trajectory(self._message, position, self._clock.stamp())

    @property
    def canceled(self) -> str:
        """Return whether an empty message has come, or there is no publisher any more."""
        if self._ended:
            return "ended by an empty trajectory"
        if not self._node.count_publishers(self._name):
            return "its sender is gone"
        return ""

    def feedback(self, experiment: Experiment) -> None:
        """The topics joint_reference and /diagnostics tell it."""
