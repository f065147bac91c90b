"""The action /run_excitation: what becomes of a goal, from its request to its result."""

import time
from typing import Protocol

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future

from crane_interfaces.action import RunExcitation
from crane_model.errors import ConfigurationError, CraneError
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion import Motion
from crane_trajectory.periodic import PeriodicTrajectory, load_trajectory
from crane_trajectory.trajectory_topics import feedback_message, result_message

FEEDBACK = 0.1  # s
PATIENCE = 2.0  # s for what a goal needs: driver enabled, joint states, crane at rest


class NotReadyError(CraneError):
    """A goal cannot begin: the driver is not enabled, joint states do not come, the crane moves."""


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

    def plan(self, trajectory: PeriodicTrajectory, periods: int) -> Motion:
        """The motion from where the crane is; `RangeError` where it may not go."""

    def open_valves(self) -> None:
        """Be the one who commands the valves."""

    def lead(self, motion: Motion) -> Experiment:
        """Begin to lead the crane."""

    def end(self) -> None:
        """The experiment has ended, or has not begun."""


class Goals:
    """Goals come one at a time; `last` tells how the last one has ended."""

    def __init__(self, node: Node, leader: Leader):
        self.last = "none"
        self._leader, self._log = leader, node.get_logger()
        self._busy = False
        self._server = ActionServer(
            node,
            RunExcitation,
            "run_excitation",
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
        except NotReadyError as error:
            return self._ended(goal, Outcome.NOT_READY, str(error))
        except CraneError as error:
            return self._ended(goal, Outcome.TRAJECTORY_REFUSED, str(error))
        finally:
            self._leader.end()
            self._busy = False

    async def _run(self, goal: ServerGoalHandle) -> RunExcitation.Result:
        trajectory = load_trajectory(goal.request.trajectory)
        if goal.request.periods < 1:
            raise ConfigurationError("periods: must be at least 1, got 0")
        if not await self._ready(goal):
            return self._ended(goal, Outcome.CANCELED, "canceled, nothing has moved")
        motion = self._leader.plan(trajectory, goal.request.periods)
        self._leader.open_valves()
        if not await self._ready(goal):
            return self._ended(goal, Outcome.CANCELED, "canceled, nothing has moved")
        self._log.info(
            f"{trajectory.name}: {motion.periods} periods, {motion.duration:.1f} s from now to rest"
        )
        experiment = self._leader.lead(motion)
        told = -np.inf
        while not experiment.over:
            await self._leader.next_watch
            if goal.is_cancel_requested:
                experiment.stop(Outcome.CANCELED, "canceled, the crane is at rest")
            if (now := time.monotonic()) - told >= FEEDBACK:
                told = now
                goal.publish_feedback(feedback_message(experiment))
        return self._ended(goal, experiment.outcome, experiment.message, experiment.rms)

    async def _ready(self, goal: ServerGoalHandle) -> bool:
        """Wait until nothing is lacking; False if canceled, `NotReadyError` if it takes long."""
        deadline = time.monotonic() + PATIENCE
        while lack := self._leader.lacking():
            if goal.is_cancel_requested:
                return False
            if time.monotonic() > deadline or not self._leader.active:
                raise NotReadyError(f"not ready: {lack}; nothing has moved")
            await self._leader.next_watch
        return True

    def _ended(
        self,
        goal: ServerGoalHandle,
        outcome: Outcome,
        message: str,
        rms: np.ndarray | None = None,
    ) -> RunExcitation.Result:
        self.last = f"{outcome.name}: {message}"
        self._log.info(self.last)
        if outcome is Outcome.COMPLETED:
            goal.succeed()
        elif outcome is Outcome.CANCELED:
            goal.canceled()
        else:
            goal.abort()
        return result_message(outcome, message, rms)
