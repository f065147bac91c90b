"""What jog shows: the keys once, and below them one line that is kept up to date."""

from collections.abc import Mapping
from types import TracebackType
from typing import NamedTuple, Self

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

STYLES = {"enabled": "bold green", "disabled": "yellow", "offline": "yellow"}
WRONG = "bold red"  # every other state
BAR = 10  # characters each way
OTHERS = (
    ("1 ... 9", "speed"),
    ("e  d", "enable, disable"),
    ("r", "reset a fault"),
    ("x", "emergency stop"),
    ("q", "quit"),
)


class StatusLine(NamedTuple):
    """What the line says."""

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.stop()

    def say(self, text: str) -> None:
        """A message that stays, above the line."""
        self._console.print(text, markup=False)

    def show(self, shown: StatusLine) -> None:
        """Renew the line."""
        self._live.update(_line(shown), refresh=True)


def _keys(pairs: Mapping[str, tuple[str, str]]) -> Table:
    table = Table.grid(padding=(0, 3))
    joints = [("", Text("-  +", style="bold"))] if pairs else []
    for joint, (down, up) in pairs.items():
        joints.append((joint, Text(f"{down}  {up}", style="bold cyan")))
    others = OTHERS if pairs else OTHERS[1:]
    for row in range(max(len(joints), len(others))):
        name, keys = joints[row] if row < len(joints) else ("", "")
        key, meaning = others[row] if row < len(others) else ("", "")
        cells = (name, keys) if joints else ()
        table.add_row("", *cells, Text(key, style="bold cyan"), meaning)
    return table


def _line(shown: StatusLine) -> Text:
    """The most important first: what does not fit is cut off."""
    line = Text(no_wrap=True, overflow="ellipsis")
    line.append(f" {shown.state:^14} ", style=f"reverse {STYLES.get(shown.state, WRONG)}")
    line.append(f"  {shown.joint:<10} {shown.command:+.2f} ")
    filled = min(BAR, round(abs(shown.share) * BAR))
    below, above = (filled, 0) if shown.command < 0 else (0, filled)
    line.append(" " * (BAR - below) + "━" * below, style="cyan")
    line.append("│", style="dim")
    line.append("━" * above + " " * (BAR - above), style="cyan")
    if shown.position is not None:
        line.append(f" {shown.position:+.4f} {shown.unit}")
    line.append(f"  {shown.note}", style="dim")
    return line
