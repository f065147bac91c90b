"""The action run_excitation: what becomes of a goal, from its request to its result."""

import time
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Future as Result
from functools import partial
from threading import Thread
from typing import Protocol, TypeVar

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from crane_interfaces.action import RunExcitation
from crane_model.errors import ConfigurationError, CraneError
from crane_nodes.node_time import NodeTime
from crane_nodes.scheduling import PATIENCE_S, give_way
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion.motion import Motion
from crane_trajectory.motion.periodic import PeriodicTrajectory
from crane_trajectory.trajectory_topics import feedback_message, result_message

ACTION = "run_excitation"
FEEDBACK = 0.1  # s
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
    """What nobody foresaw, in words."""
    return (
        f"{type(error).__name__}: {error}. This is a defect of the program: report it, with the "
        "log of the node and the trajectory"
    )


def bounded(message: str) -> str:
    """A message with its middle left out where it is too long: it begins with what it is about, as
    a path, and ends with what to do.
    """
    beyond = len(message) - LONGEST_MESSAGE
    if beyond <= 0:
        return message
    half = LONGEST_MESSAGE // 2
    return f"{message[:half]} ... ({beyond} characters left out) ... {message[-half:]}"


class Leader(Protocol):
    """Who leads the crane."""

    @property
    def active(self) -> bool:
        """Whether goals may begin at all."""

    @property
    def next_watch(self) -> Future:
        """Done when the experiment has been looked at again."""

    def lacking(self) -> str:
        """What is in the way of an experiment; empty if nothing is."""

    def read(self, trajectory: str) -> PeriodicTrajectory:
        """What a goal names, in any thread; `ConfigurationError` if it is wrong."""

    def planner(self, trajectory: PeriodicTrajectory, periods: int) -> Callable[[], Motion]:
        """What plans the motion from where the crane is now, in any thread; it raises `RangeError`
        where the crane may not go.
        """

    def open_valves(self) -> None:
        """Be the one who commands the valves."""

    def lead(self, motion: Motion) -> Experiment:
        """Begin to lead the crane; `NotReadyError` if it is not where the motion starts."""

    def end(self) -> None:
        """The experiment has ended, or has not begun."""


class Goals:
    """Goals come one at a time; `last` tells how the last one has ended."""

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
        if self._busy:
            return self._ended(goal, Outcome.NOT_READY, "another goal runs; cancel it first")
        self._busy = True
        try:
            return await self._run(goal)
        except CanceledError as error:
            return self._ended(goal, Outcome.CANCELED, str(error))
        except NotReadyError as error:
            return self._ended(goal, Outcome.NOT_READY, str(error))
        except UnexpectedError as error:
            return self._ended(goal, Outcome.FAILED, str(error))
        except CraneError as error:
            return self._ended(goal, Outcome.TRAJECTORY_REFUSED, str(error))
        except Exception as error:
            return self._ended(goal, Outcome.FAILED, self._told(error))
        finally:
            self._leader.end()
            self._busy = False

    async def _run(self, goal: ServerGoalHandle) -> RunExcitation.Result:
        if goal.request.periods < 1:
            raise ConfigurationError("periods: must be at least 1, got 0")
        trajectory = await self._aside(goal, partial(self._leader.read, goal.request.trajectory))
        await self._ready(goal)
        planner = self._leader.planner(trajectory, goal.request.periods)
        motion = await self._aside(goal, planner)
        self._leader.open_valves()
        await self._ready(goal)
        self._log.info(
            f"{trajectory.name}: {motion.periods} periods, {motion.duration:.1f} s from now to rest"
        )
        experiment = self._leader.lead(motion)
        told = -np.inf
        while not experiment.over:
            await self._leader.next_watch
            real = time.monotonic()
            try:
                if goal.is_cancel_requested:
                    experiment.stop(Outcome.CANCELED, "canceled, the crane is at rest")
                if real - told >= FEEDBACK:
                    told = real
                    goal.publish_feedback(feedback_message(experiment))
            except Exception as error:
                experiment.release(Outcome.FAILED, self._told(error), self._clock.now())
        return self._ended(goal, experiment.outcome, experiment.account, experiment.rms)

    def _told(self, error: Exception) -> str:
        """A defect in words, when the log has been told where it is."""
        self._log.error(traceback.format_exc())
        return defect(error)

    async def _aside(self, goal: ServerGoalHandle, work: Callable[[], Made]) -> Made:
        """What `work` returns, while the executor does all the rest; `CanceledError` if canceled.

        The thread is left to itself then: a file may be on a disk that does not answer.
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
            await self._next_watch(goal)
        return result.result()

    async def _ready(self, goal: ServerGoalHandle) -> None:
        """Wait until nothing is lacking; `NotReadyError` if it takes long, `CanceledError`."""
        begun, really = self._clock.now(), time.monotonic()
        while lack := self._leader.lacking():
            waited = self._clock.now() - begun > READINESS_TIMEOUT_S
            if waited or time.monotonic() - really > PATIENCE_S or not self._leader.active:
                raise NotReadyError(f"not ready: {lack}; nothing has moved")
            await self._next_watch(goal)

    async def _next_watch(self, goal: ServerGoalHandle) -> None:
        """For as long as nothing moves."""
        if goal.is_cancel_requested:
            raise CanceledError("canceled, nothing has moved")
        await self._leader.next_watch

    def _ended(
        self,
        goal: ServerGoalHandle,
        outcome: Outcome,
        message: str,
        rms: np.ndarray | None = None,
    ) -> RunExcitation.Result:
        message = bounded(message)
        result = result_message(outcome, message, self._units, rms)
        self.last = f"{outcome.name}: {message}"
        self._log.info(self.last)
        if outcome is Outcome.COMPLETED:
            goal.succeed()
        elif outcome is Outcome.CANCELED:
            goal.canceled()
        else:
            goal.abort()
        return result
