"""`ros2 run crane_driver jog`: hold-to-run motion of one joint, by keyboard or joystick.

Software is not a safety stop: keep the emergency stop of the machine within reach.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.task import Future
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text
from sensor_msgs.msg import JointState, Joy

from crane_driver import constants
from crane_driver.operator import by_hand
from crane_driver.operator.jog.jog_input import (
    CONTROLS,
    Axis,
    CommandShape,
    Demand,
    JogMotion,
    Joystick,
    Keyboard,
    KeyTerminal,
    NoTerminal,
    Request,
)
from crane_interfaces.msg import DriverState, ValveCommand
from crane_model.cli import command_line, run
from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine_files import machine_file
from crane_nodes.driver_client import DriverClient, NoDriverError
from crane_nodes.executor import KeptExecutor
from crane_nodes.joint_notes import JointNote, load_joint_notes
from crane_nodes.managed import Stop, own_arguments, publishers, ros, say_ready
from crane_nodes.node_time import NodeTime
from crane_nodes.parameters import MACHINE, NodeParameter, Number, declare, declare_machine

STATE_STYLES = {"enabled": "bold green", "disabled": "yellow", "offline": "yellow"}
WRONG_STATE_STYLE = "bold red"  # every other state
BAR_CHARACTERS = 10  # characters each way
OTHER_KEYS = (
    ("1 ... 9", "speed"),
    ("e  d", "enable, disable"),
    ("r", "reset a fault"),
    ("x", "emergency stop"),
    ("q", "quit"),
)

MAXIMUM = Number("maximum", 0.3, "1", 0.05, 1.0, "Valve command at step 10, or of a full axis")
HOLD = Number("hold", 0.12, "s", 0.05, 0.15, "How long each character of a key holds its joint")
RISE_TIME = Number("rise_time", 0.3, "s", 0.05, 5.0, "From neutral to the maximum")
FALL_TIME = Number("fall_time", 0.03, "s", 0.01, 0.1, "From the maximum to neutral")
# Left bumper of a game pad, as `joy_node` of ROS has it.
DEADMAN = Number("joy.deadman", 4, "1", 0, 63, "Button to be held, counted from 0", whole=True)

NEWEST_MESSAGE = QoSProfile(depth=1)


class StatusLine(NamedTuple):
    """Content of the status line."""

    state: str  # of the driver
    joint: str  # that is commanded, or was last
    command: float
    share: float  # of the largest command
    position: float | None
    unit: str  # of the position
    note: str


class Screen:
    """The terminal as a display."""

    def __init__(self, pairs: Mapping[str, tuple[str, str]]):
        """`pairs`: the keys of each joint, down and up; none where there is a joystick."""
        self._console = Console(highlight=False)
        self._live = Live(console=self._console, auto_refresh=False, redirect_stdout=False,
                          redirect_stderr=False)  # fmt: skip
        self._pairs = pairs

    def __enter__(self) -> Self:
        if self._pairs:
            self._console.print("Hold a key to move a joint; let go and it stops.")
        else:
            self._console.print("Hold the deadman button and push one axis; let go and it stops.")
        self._console.print(_keys(self._pairs))
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def say(self, text: str) -> None:
        self._console.print(text, markup=False)

    def show(self, shown: StatusLine) -> None:
        self._live.update(_line(shown), refresh=True)


def _keys(pairs: Mapping[str, tuple[str, str]]) -> Table:
    table = Table.grid(padding=(0, 3))
    joints = [("", Text("-  +", style="bold"))] if pairs else []
    for joint, (down, up) in pairs.items():
        joints.append((joint, Text(f"{down}  {up}", style="bold cyan")))
    others = OTHER_KEYS if pairs else OTHER_KEYS[1:]
    for row in range(max(len(joints), len(others))):
        name, keys = joints[row] if row < len(joints) else ("", "")
        key, meaning = others[row] if row < len(others) else ("", "")
        cells = (name, keys) if joints else ()
        table.add_row("", *cells, Text(key, style="bold cyan"), meaning)
    return table


def _line(shown: StatusLine) -> Text:
    """The most important first: what does not fit is cut off."""
    line = Text(no_wrap=True, overflow="ellipsis")
    line.append(
        f" {shown.state:^14} ", style=f"reverse {STATE_STYLES.get(shown.state, WRONG_STATE_STYLE)}"
    )
    line.append(f"  {shown.joint:<10} {shown.command:+.2f} ")
    filled = min(BAR_CHARACTERS, round(abs(shown.share) * BAR_CHARACTERS))
    below, above = (filled, 0) if shown.command < 0 else (0, filled)
    line.append(" " * (BAR_CHARACTERS - below) + "━" * below, style="cyan")
    line.append("│", style="dim")
    line.append("━" * above + " " * (BAR_CHARACTERS - above), style="cyan")
    if shown.position is not None:
        line.append(f" {shown.position:+.4f} {shown.unit}")
    line.append(f"  {shown.note}", style="dim")
    return line


class JogParameters(NamedTuple):
    """Those of each joint, by joint."""

    dead_band: Mapping[str, Number]
    axis: Mapping[str, Number]
    sign: Mapping[str, Number]

    @classmethod
    def of(cls, notes: Mapping[str, JointNote]) -> "JogParameters":
        dead_band, axis, sign = {}, {}, {}
        for joint, note in notes.items():
            dead_band[joint] = Number(
                f"dead_band.{joint}",
                *(0.05, "1", 0.0, 0.5),
                f"Valve command that does not move {joint} yet",
            )
            axis[joint] = Number(
                f"joy.axis.{joint}",
                *(note.joystick_axis, "1", 0, 63),
                f"Axis of {joint}, counted from 0",
                whole=True,
            )
            sign[joint] = Number(
                f"joy.sign.{joint}",
                *(1, "1", -1, 1),
                f"-1 if the axis of {joint} is reversed",
                whole=True,
            )
        return cls(dead_band, axis, sign)

    @property
    def all(self) -> tuple[NodeParameter, ...]:
        of_joints = (self.dead_band.values(), (DEADMAN,), self.axis.values(), self.sign.values())
        return (
            MAXIMUM,
            HOLD,
            RISE_TIME,
            FALL_TIME,
            *(parameter for group in of_joints for parameter in group),
        )

    def shape(self, node: Node) -> CommandShape:
        dead_band = {joint: parameter.read(node) for joint, parameter in self.dead_band.items()}
        return CommandShape(
            MAXIMUM.read(node), dead_band, RISE_TIME.read(node), FALL_TIME.read(node)
        )

    def joystick(self, node: Node) -> Joystick:
        """The joystick; `ConfigurationError` where one axis has two joints."""
        axes: dict[str, Axis] = {}
        owners: dict[int, str] = {}
        for joint, parameter in self.axis.items():
            index, sign = int(parameter.read(node)), int(self.sign[joint].read(node))
            if index in owners:
                raise ConfigurationError(
                    f"parameter '{parameter.name}': axis {index} belongs to {owners[index]} already"
                )
            if not sign:
                raise ConfigurationError(
                    f"parameter '{self.sign[joint].name}': must be -1 or 1, got 0"
                )
            owners[index] = joint
            axes[joint] = Axis(index, sign)
        return Joystick(int(DEADMAN.read(node)), axes)


class JogError(CraneError):
    """Jogging cannot begin. Examples: no driver runs, another node commands the valves."""


class Jog(Node):
    """Publishes commands while it runs; the driver allows one publisher at a time."""

    def __init__(self, by_joystick: bool):
        super().__init__("jog")
        self._units = declare_machine(self).units
        notes = load_joint_notes(machine_file("joints.yaml", MACHINE.read(self)), self._units)
        parameters = JogParameters.of(notes)
        declare(self, parameters.all, read_only=parameters.all)
        self._shape = parameters.shape(self)
        self.motion = JogMotion(self._shape)
        self.keyboard = Keyboard(HOLD.read(self), tuple(self._units))
        self.joystick = parameters.joystick(self) if by_joystick else None
        self.messages: list[str] = []
        self._positions: dict[str, float] = {}
        self._commands = dict.fromkeys(self._units, 0.0)
        self._moved = next(iter(self._units))
        self._publisher: Publisher | None = None
        self.clock = NodeTime(self)
        self.clock.listen()
        self._driver = DriverClient(self, self._told)
        self._faulty = False
        self._worker = KeptExecutor()
        self._worker.add_node(self)
        self.create_subscription(JointState, "joint_states", self._measured, NEWEST_MESSAGE)
        if by_joystick:
            self.create_subscription(Joy, "joy", self._pushed, NEWEST_MESSAGE)

    def begin(self, stop: Stop) -> None:
        """Wait for the driver and become its publisher of commands; `JogError` if that fails."""
        until = time.monotonic() + self.clock.patience(constants.DRIVER_TIMEOUT_S)
        while not self._driver.ready:
            self._wait(stop, until, self._driver.problem or "no services of the driver")
        if others := publishers(self, "valve_command"):
            raise JogError(f"{', '.join(others)} commands the valves already; stop it first")
        self._publisher = self.create_publisher(ValveCommand, "valve_command", NEWEST_MESSAGE)
        while not self._publisher.get_subscription_count():
            self._wait(stop, until, "the driver takes no commands: is it active?")
        while not self.clock.known:  # no command is stamped before that
            self._wait(stop, until, "no time on /clock: is the driver active?")
        say_ready(self)

    def work(self) -> None:
        for _ in range(constants.JOG_CALLBACKS):
            self._worker.spin_once(timeout_sec=0.0)

    def command(self, demand: Demand | None) -> None:
        self._commands = self.motion.step(demand, self.clock.now())
        self._moved = next((joint for joint in self._units if self._commands[joint]), self._moved)
        message = ValveCommand(name=list(self._commands), command=list(self._commands.values()))
        message.header.stamp = self.clock.stamp()
        if self._publisher:
            self._publisher.publish(message)

    def stop(self) -> None:
        """Ramp to neutral, so that the driver sees an end and not a loss of commands, and leave.

        Nobody waits then for commands of a jog whose terminal does not end.
        """
        left = constants.LAST_COMMANDS
        while self._publisher and left:
            self.command(None)
            left -= self.motion.neutral
            self._worker.spin_once(timeout_sec=0.0)  # of what time it is
            time.sleep(constants.COMMAND_PERIOD_S)
        if self._publisher:
            self._publisher.wait_for_all_acked(Duration(seconds=0.5))
            self.destroy_publisher(self._publisher)
            self._publisher = None

    def demand(self) -> Demand | None:
        return (self.joystick or self.keyboard).demand(self.clock.now())

    def request(self, request: Request) -> None:
        """Call a service of the driver; the answer becomes a message."""
        try:
            futures = self._asked(request)
        except NoDriverError as error:
            self.messages.append(f"{request}: {error}")
            return
        for future in futures:
            future.add_done_callback(lambda done: self._answered(request, done))

    def shown(self) -> StatusLine:
        note = self.joystick.problem if self.joystick else f"speed {self.keyboard.step}"
        command = self._commands[self._moved]
        share = command / self._shape.maximum
        state, position = self._driver.state.text, self._positions.get(self._moved)
        unit = self._units[self._moved]
        return StatusLine(state, self._moved, command, share, position, unit, note)

    def _asked(self, request: Request) -> list[Future]:
        match request:
            case Request.ENABLE:
                return [self._driver.enable()]
            case Request.DISABLE:
                return [self._driver.disable()]
            case Request.RESET:
                return [self._driver.reset_fault()]
            case Request.EMERGENCY_STOP:
                return self._driver.stop()
        raise ValueError(f"{request} is not a service of the driver")

    def _wait(self, stop: Stop, until: float, problem: str) -> None:
        if stop.requested:
            raise KeyboardInterrupt
        if time.monotonic() > until:
            raise JogError(problem)
        self._worker.spin_once(timeout_sec=0.05)

    def _answered(self, request: Request, future: Future) -> None:
        answer = future.result()
        if answer and answer.success:
            self.messages.append(f"{request}: {answer.message}")
        elif answer:
            self.messages.append(answer.message)

    def _measured(self, message: JointState) -> None:
        self._positions = dict(zip(message.name, message.position, strict=True))

    def _told(self, state: DriverState) -> None:
        faulty = state.state == DriverState.STATE_FAULT
        if faulty and not self._faulty:
            self.messages.append(f"{state.text}: {state.cause}; {state.remedy}")
        self._faulty = faulty

    def _pushed(self, message: Joy) -> None:
        if self.joystick:
            self.joystick.received(message.axes, message.buttons, self.clock.now())


def main(argv: Sequence[str] | None = None) -> int:
    """Jog until q or a signal."""
    argv = sys.argv[1:] if argv is None else argv
    options = _parser().parse_args(own_arguments(argv))
    return run(lambda: _run(argv, options.joy))


def _run(argv: Sequence[str], by_joystick: bool) -> None:
    terminal = NoTerminal() if by_joystick and not sys.stdin.isatty() else KeyTerminal()
    with ros(argv) as stop:
        jog = Jog(by_joystick)
        try:
            jog.begin(stop)
            with terminal, Screen({} if by_joystick else jog.keyboard.pairs) as screen:
                try:
                    _jog(jog, terminal, screen, stop)
                finally:
                    jog.stop()  # before a terminal that may take its time
        finally:
            jog.destroy_node()


def _jog(jog: Jog, terminal: KeyTerminal | NoTerminal, screen: Screen, stop: Stop) -> None:
    controls = {} if isinstance(terminal, NoTerminal) else CONTROLS
    due = refresh = time.monotonic()
    while not stop.requested and not terminal.closed:
        typed = terminal.read(due - time.monotonic())
        request = jog.keyboard.typed(typed, jog.clock.now())
        if request is Request.QUIT:
            return
        if request:
            jog.request(request)
        now = time.monotonic()
        if now < due:
            continue
        jog.work()
        jog.command(jog.demand())
        due = max(due + constants.COMMAND_PERIOD_S, now)
        if now >= refresh:
            refresh = now + constants.REFRESH_PERIOD_S
            for text in jog.messages:
                screen.say(by_hand(text, controls))
            jog.messages.clear()
            screen.show(jog.shown())


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="jog",
        description="Moves one joint of the crane while a key is held: each character that the "
        "terminal repeats holds the joint for 0.12 s. The keys are shown when it runs.",
        epilog="Parameters, after --ros-args -p: machine, maximum, hold, rise_time, fall_time, "
        "dead_band.JOINT, joy.deadman, joy.axis.JOINT, joy.sign.JOINT; `ros2 param describe /jog "
        "NAME` explains them. Software is not a safety stop.",
    )
    parser.add_argument(
        "--joy",
        action="store_true",
        help="follow a joystick (sensor_msgs/Joy on /joy) with a deadman button",
    )
    return parser
