"""`ros2 run crane_trajectory run_excitation`: sends a goal to the trajectory node and shows it run.

HAZARD: the crane moves by itself. Ctrl-C brings it to rest; software is not a safety stop.
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from tqdm import tqdm

from crane_interfaces.action import RunExcitation
from crane_model.cli import INTERRUPTED, add_replace, check_out, command_line, run, whole
from crane_model.errors import CraneError
from crane_model.machine import Machine
from crane_model.progress_bar import BAR, progress_bar
from crane_model.result_file import NumberByJoint, ResultFile
from crane_nodes.driver_client import DriverClient
from crane_nodes.executor import KeptExecutor
from crane_nodes.managed import Stop, own_arguments, ros, say_ready
from crane_nodes.this_computer import PATIENCE_S
from crane_trajectory.experiment import Outcome
from crane_trajectory.motion.motion import Phase
from crane_trajectory.run_excitation_action import ACTION
from crane_trajectory.trajectory_topics import sample

MOST_PERIODS = 2**32 - 1  # that the goal can hold
ELAPSED = "{desc}" + BAR + " {n:.0f} of {total:.0f} s{postfix}"
DISCOVERY_TIMEOUT_S = 10.0  # for the nodes to be there
WAKE = 0.1  # s


class ExcitationError(CraneError):
    """The experiment was not completed, or could not be asked for.

    Examples: no trajectory node runs, the driver refuses to be enabled, tracking was lost.
    """


class ExcitationResult(ResultFile):
    """How an experiment ended (`run_excitation --result`)."""

    outcome: str
    """`COMPLETED`, or what ended it: the constants of the action."""
    message: str
    """The same in a sentence."""
    rms_tracking_error: NumberByJoint
    """RMS tracking error of the periods that were run [rad, m]; null if there was none."""


class RunExcitationClient(Node):
    """Asks for one experiment, and waits for its end whatever happens."""

    def __init__(self, stop: Stop, name: str = "run_excitation"):
        super().__init__(name)
        self._stop = stop
        self._worker = KeptExecutor()
        self._worker.add_node(self)
        self._action = ActionClient(self, RunExcitation, ACTION)
        self._driver = DriverClient(self)
        self._bar: tqdm | None = None

    @contextmanager
    def enabled(self) -> Iterator[None]:
        """The driver, enabled within the `with` block; `ExcitationError` if it refuses."""
        self._await(lambda: self._driver.ready, lambda: self._driver.problem)
        self._accepted(self._driver.enable())
        try:
            yield
        finally:
            self._accepted(self._driver.disable())

    def position(self, machine: Machine) -> np.ndarray:
        """(j,) where the joints are now [rad, m]; `ExcitationError` if no joint state comes."""
        found: list[np.ndarray] = []

        def take(message: JointState) -> None:
            found.append(sample(message, machine.joint_names).position)

        subscription = self.create_subscription(JointState, "joint_states", take, 1)
        self._await(lambda: bool(found), lambda: "no joint states arrive; start the driver")
        self.destroy_subscription(subscription)
        return found[-1]

    def run(self, trajectory: Path, periods: int) -> RunExcitation.Result:
        """The result of the goal; a signal cancels it, and it is waited for all the same."""
        self._await(self._action.server_is_ready, lambda: "no trajectory node answers; start one")
        say_ready(self)
        goal = RunExcitation.Goal(trajectory=name_for_node(trajectory), periods=periods)
        with progress_bar("", 0.0, form=ELAPSED, patience=0.0) as bar:
            self._bar = bar
            sent = self._action.send_goal_async(goal, self._show)
            handle = self._answer(sent, "the trajectory node")
            if not handle.accepted:
                raise ExcitationError("the trajectory node does not accept goals; activate it")
            ending = handle.get_result_async()
            canceling: Future | None = None
            while not ending.done():
                if self._stop.requested and canceling is None:
                    bar.set_description("coming to rest")
                    canceling = handle.cancel_goal_async()
                self._worker.spin_once(timeout_sec=WAKE)
                if not self._action.server_is_ready():
                    raise ExcitationError("the trajectory node is gone; the driver stops the crane")
        answer = ending.result()
        if answer.status == GoalStatus.STATUS_UNKNOWN:
            raise ExcitationError("the trajectory node does not know the goal any more")
        return answer.result

    def _show(self, message: Any) -> None:
        feedback = message.feedback
        assert self._bar is not None
        self._bar.total = max(feedback.duration, feedback.elapsed)
        self._bar.n = feedback.elapsed
        errors = (
            f"{joint} {error * 1e3:+z.0f} m{unit}"
            for joint, unit, error in zip(
                feedback.name, feedback.unit, feedback.tracking_error, strict=True
            )
        )
        if not self._stop.requested:
            self._bar.set_description(Phase(feedback.phase).name.lower(), refresh=False)
        self._bar.set_postfix_str("error: " + ", ".join(errors), refresh=False)
        self._bar.refresh()

    def _accepted(self, request: Future) -> None:
        answer = self._answer(request, "the driver")
        if not answer.success:
            raise ExcitationError(f"the driver refuses: {answer.message}")

    def _answer(self, future: Future, asked: str) -> Any:
        self._await(future.done, lambda: f"{asked} does not answer; see its log")
        return future.result()

    def _await(self, condition: Callable[[], bool], otherwise: Callable[[], str]) -> None:
        simulated = self.get_parameter("use_sim_time").value is True
        longest = PATIENCE_S if simulated else DISCOVERY_TIMEOUT_S  # of real time in both cases
        until = time.monotonic() + longest
        while not condition():
            if time.monotonic() > until:
                raise ExcitationError(f"{otherwise()} (waited {longest:g} s)")
            self._worker.spin_once(timeout_sec=WAKE)


def name_for_node(trajectory: Path) -> str:
    """Name of a file for the trajectory node, in whatever folder it runs: the absolute path, or the
    bare name of a trajectory of its machine if there is no such file.
    """
    bare = trajectory.name == str(trajectory) and not trajectory.exists()
    return str(trajectory if bare else trajectory.absolute())


class RunRequest(NamedTuple):
    """Request of `run_excitation`."""

    trajectory: Path
    periods: int
    enable: bool
    result: Path | None
    replace: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Run an excitation trajectory on the crane; exit status 0 if it was completed."""
    argv = sys.argv if argv is None else ["run_excitation", *argv]
    request = _request(own_arguments(argv[1:]))
    interrupted = False

    def body() -> None:
        nonlocal interrupted
        if request.result:
            check_out(request.result, replace=request.replace)
        with ros(argv) as stop:
            client = RunExcitationClient(stop)
            with client.enabled() if request.enable else nullcontext():
                result = client.run(request.trajectory, request.periods)
            interrupted = stop.requested
        if request.result:
            _write(request.result, result)
        tell(result)

    status = run(body)
    return INTERRUPTED if interrupted and status else status


def _request(argv: Sequence[str]) -> RunRequest:
    parser = command_line(prog="run_excitation", description=main.__doc__)
    add = parser.add_argument
    add(
        "--trajectory",
        type=Path,
        required=True,
        help="trajectory file on the computer of the trajectory node, or the bare name"
        " of one in the machine folder",
    )
    add("--periods", type=whole(1, MOST_PERIODS), required=True, help="number of periods to run")
    add("--enable", action="store_true", help="enable the driver before, and disable it after")
    add("--result", type=Path, metavar="FILE", help="new file for the result of the action (JSON)")
    add_replace(parser)
    return RunRequest(**vars(parser.parse_args(argv)))


def _write(file: Path, result: RunExcitation.Result) -> None:
    ExcitationResult(
        outcome=Outcome(result.outcome).name,
        message=result.message,
        rms_tracking_error=dict(zip(result.name, result.rms_tracking_error.tolist(), strict=True)),
    ).write(file)


def tell(result: RunExcitation.Result) -> None:
    """Print the result; `ExcitationError` unless it was completed."""
    for joint, unit, error in zip(result.name, result.unit, result.rms_tracking_error, strict=True):
        print(f"RMS tracking error, {joint}: {error:.4g} {unit}")
    outcome = Outcome(result.outcome)
    if outcome is not Outcome.COMPLETED:
        raise ExcitationError(f"{outcome.name}: {result.message}")
    print(f"{outcome.name}: {result.message}")
