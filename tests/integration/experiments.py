"""The trajectory node as a process over driver and simulated crane, and what it says."""

import subprocess
import time
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import yaml
from integration.driver_stage import Stage, made
from integration.matched import wait_until_heard
from integration.processes import COMMAND_TIMEOUT, CONTROLLER_PRIORITY, URGENT, start
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from unique_identifier_msgs.msg import UUID

from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import JointReference, ValveCommand
from crane_trajectory.experiment import Outcome

Feedback = RunExcitation.Impl.FeedbackMessage
TRAJECTORY = URGENT.format(module="crane_trajectory.trajectory_node", priority=CONTROLLER_PRIORITY)
PERIOD = 5.0  # s
TIMEOUT = COMMAND_TIMEOUT / 2  # s
SHORT = {
    "name": "short",
    "period": PERIOD,
    "joints": {
        "inner_boom": {"offset": 0.35, "sine": [0.06], "cosine": [0.02]},
        "outer_boom": {"offset": -1.5, "sine": [0.0, 0.06], "cosine": [0.1, 0.0]},
        "telescope": {"offset": 0.4, "sine": [0.1], "cosine": [0.05]},
    },
}
MOVING = 0.03  # rad/s, m/s
TRIES = 6
LONG = 10  # periods, so that a goal does not end by itself while a busy test machine is late
NEXT = 0.0075  # s, by which commands of the next cycle follow


class Experiments:
    """The node under test, and what it says."""

    def __init__(
        self,
        stage: Stage,
        folder: Path,
        *arguments: str,
        trajectory: dict[str, Any] = SHORT,
        program: str = TRAJECTORY,
    ):
        """`arguments` are ROS arguments of the node."""
        self._program = program
        self.stage, self.folder, self.arguments = stage, folder, arguments
        self.file = folder / "short.yaml"
        self.file.write_text(yaml.safe_dump(trajectory))
        self.references: list[JointReference] = []
        self.commands: list[ValveCommand] = []
        self.feedback: list[Any] = []
        node = stage.node
        stage.listen(JointReference, "/joint_reference", self.references.append)
        stage.listen(ValveCommand, "/valve_command", self.commands.append)
        # The action client drops what it has not taken by the time of the result.
        stage.listen(Feedback, "/run_excitation/_action/feedback", self._told)
        self._goal = UUID()
        self.action = ActionClient(node, RunExcitation, "/run_excitation")
        self._set = node.create_client(SetParameters, "/trajectory/set_parameters")
        self._change = node.create_client(ChangeState, "/trajectory/change_state")
        self.process: subprocess.Popen[str]
        self.begin()

    def begin(self) -> None:
        own = "--ros-args", "-p", f"states_timeout:={TIMEOUT}"
        self.process = start(self._program, *own, *self.arguments)
        for ready in (self.action.server_is_ready, self._set.service_is_ready):
            self.stage.until(ready)
        self.stage.until(self._change.service_is_ready)
        wait_until_heard(self.stage.node, "/trajectory", self.stage.until)

    def send(self, file: Path | None = None, periods: int = 1) -> Any:
        """A goal; its handle. `feedback` is that of the newest goal."""
        request = RunExcitation.Goal(trajectory=str(file or self.file), periods=periods)
        self.feedback = []  # what comes late of the goal before does not get into it
        self._goal = UUID(uuid=list(uuid4().bytes))
        sent = self.action.send_goal_async(request, goal_uuid=self._goal)
        self.stage.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    def _told(self, message: Feedback) -> None:
        if bytes(message.goal_id.uuid) == bytes(self._goal.uuid):
            self.feedback.append(message.feedback)

    def result(self, handle: Any) -> RunExcitation.Result:
        ending = handle.get_result_async()
        self.stage.until(ending.done)
        return ending.result().result

    def ended(
        self, outcome: Outcome, file: Path | None = None, periods: int = 1
    ) -> RunExcitation.Result:
        """The result of a goal that ends so, and alone in `commands` and `references`; others end
        by true faults, which a busy test machine makes.
        """
        for _ in range(TRIES):
            self.stage.enabled()
            self.commands.clear()
            self.references.clear()
            result = self.result(self.send(file, periods))
            if result.outcome == outcome:
                return result
        raise AssertionError(f"{Outcome(result.outcome).name}: {result.message}")

    def refused(self, file: Path | None = None, periods: int = 1) -> RunExcitation.Result:
        """The result of a goal that must not move anything, however long it takes to be refused."""
        self.stage.spin()  # takes what was sent before
        since, asked = len(self.stage.valves), time.time()
        result = self.result(self.send(file, periods))
        assert not any(any(one.commands.values()) for one in self.stage.valves[since:])
        assert not any(np.any(one.command) for one in self.commands if made(one) > asked)
        return result

    def moving(self) -> Any:
        """The handle of a goal under which the crane moves."""
        for _ in range(5):  # a test machine that is too busy makes true faults
            self.stage.enabled()
            handle = self.send(periods=LONG)
            accepted, ending = time.time(), handle.get_result_async()

            def moves(accepted: float = accepted) -> bool:
                """By a state made since; the crane may have moved before."""
                return made(self.stage.states[-1]) > accepted and self.speed() > MOVING

            self.stage.until(lambda ending=ending, moves=moves: ending.done() or moves())
            if not ending.done():
                return handle
        raise AssertionError("the crane does not move")

    def largest_step(self) -> float:
        """Of a command from cycle to cycle; those that come late, or after one that is lost, may
        have changed by more.
        """
        follows = np.diff([made(one) for one in self.commands]) < NEXT
        assert np.count_nonzero(follows) > 0.5 * len(follows), "most are on time"
        moving = np.array([one.command for one in self.commands])
        return float(np.abs(np.diff(moving, axis=0))[follows].max())

    def speed(self) -> float:
        return float(np.abs(self.stage.states[-1].velocity).max())

    @property
    def position(self) -> np.ndarray:
        return np.array(self.stage.states[-1].position)

    def holds_still(self) -> None:
        """No publisher of commands; then, for half a second, nothing moves or creeps."""
        self.stage.until(lambda: self.stage.node.count_publishers("/valve_command") == 0)
        gone = time.time()  # a busy test machine takes states that were made long before

        def still() -> bool:
            last = self.stage.states[-100:]
            way = np.ptp([one.position for one in last], axis=0)
            return made(last[0]) > gone and self.speed() < MOVING and way.max() < 0.01

        self.stage.until(still)

    def set(self, name: str, value: float | str) -> tuple[bool, str]:
        given = (
            ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
            if isinstance(value, str)
            else ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        )
        request = SetParameters.Request(parameters=[Parameter(name=name, value=given)])
        future = self._set.call_async(request)
        self.stage.until(future.done)
        (answer,) = future.result().results
        return answer.successful, answer.reason

    def change(self, transition: int) -> None:
        assert self.tries(transition)

    def tries(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        future = self._change.call_async(request)
        self.stage.until(future.done)
        return future.result().success
