"""The chart on the page "Which command?": from what one has, stage by stage, to commands.

It is SVG that goes into the page, so that it takes the colours of the page, light and dark.
"""

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

WIDTH, LEFT, ROW, BOX = 460.0, 150.0, 78.0, 54.0  # px: chart, stages from there on, rows, a box
COMMANDS = "reference/generated/commands_{package}.html#{anchor}"
PAGE = """```{{raw}} html
<div class="imports chart">{svg}</div>
```
"""


class Stage(NamedTuple):
    """A task, the commands that do it, and its page in the manual."""

    task: str
    page: str
    commands: tuple[str, ...]


class Entry(NamedTuple):
    """What a reader may have, and the number of the stage to begin at."""

    has: tuple[str, ...]
    stage: int


STAGES = (
    Stage("Describe the machine", "how_to/machine_file.html", ("crane_model machine",)),
    Stage(
        "Bring it up",
        "how_to/bring_up.html",
        (
            "crane_benchmark rehearse",
            "crane_driver driver",
            "crane_driver bringup",
            "crane_driver jog",
        ),
    ),
    Stage(
        "Excite it",
        "how_to/excite.html",
        (
            "crane_trajectory design",
            "crane_trajectory trajectory",
            "crane_trajectory run_excitation",
            "crane_trajectory move",
        ),
    ),
    Stage(
        "Record or import",
        "how_to/record.html",
        ("crane_nodes recorder", "crane_sim make_bag", "crane_driver decode"),
    ),
    Stage(
        "Check",
        "how_to/record.html#check",
        ("crane_identification check_recording", "crane_observer check_sensors"),
    ),
    Stage(
        "Identify",
        "how_to/identify.html",
        (
            "crane_identification identify",
            "crane_identification simulate",
            "crane_identification identification",
        ),
    ),
    Stage("Find what is missing", "how_to/diagnose.html", ("crane_identification diagnose",)),
    Stage(
        "Control, watch, weigh",
        "how_to/index.html",
        (
            "crane_trajectory tune",
            "crane_driver panel",
            "crane_viewer viewer",
            "crane_observer estimate_payload",
        ),
    ),
)
ENTRIES = (
    Entry(("a crane",), 0),
    Entry(("recordings,", "or no crane yet"), 3),
    Entry(("a model",), 7),
)
AGAIN = 6, 2  # from the diagnosis back to a motion that discriminates


def pages() -> dict[str, str]:
    """The chart, which the page includes."""
    return {"which_command.txt": PAGE.format(svg=chart(STAGES, ENTRIES))}


def chart(stages: Sequence[Stage], entries: Sequence[Entry]) -> str:
    """Boxes of the stages from top to bottom, with entries on their left."""
    height = ROW * len(stages) - (ROW - BOX) + 2.0
    middle = (LEFT + WIDTH) / 2.0
    parts = [_stage(one, _top(row)) for row, one in enumerate(stages)]
    parts += [
        _arrow((middle, _top(row) + BOX), (middle, _top(row + 1))) for row in range(len(stages) - 1)
    ]
    for entry in entries:
        y = _top(entry.stage) + BOX / 2.0
        first = y - 7.0 * (len(entry.has) - 1)
        parts += [_text(52.0, first + 14.0 * i, line) for i, line in enumerate(entry.has)]
        parts.append(_arrow((108.0, y), (LEFT, y)))
    begin, end = (_top(row) + BOX / 2.0 for row in AGAIN)
    parts.append(_path(f"M{LEFT} {begin} H{LEFT - 24} V{end + 10} H{LEFT}"))
    parts.append(_head(LEFT, end + 10.0, 1.0, 0.0))
    label = "Chart: from a crane, recordings or a model to the commands of each task"
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {height:g}" width="{WIDTH:g}" role="img" '
        f'aria-label="{label}">{"".join(parts)}</svg>'
    )


def _top(row: int) -> float:
    return ROW * row + 1.0


def _stage(stage: Stage, top: float) -> str:
    middle = (LEFT + WIDTH) / 2.0
    frame = f'<rect x="{LEFT}" y="{top}" width="{WIDTH - LEFT - 1.0}" height="{BOX}" rx="4"/>'
    commands = " · ".join(
        f'<a href="{_address(one)}">{escape(one.partition(" ")[2])}</a>' for one in stage.commands
    )
    task = f'<a href="{stage.page}">{escape(stage.task)}</a>'
    return frame + _text(middle, top + 17.0, task, "task") + _text(middle, top + 38.0, commands)


def _address(command: str) -> str:
    package, name = command.split()
    return COMMANDS.format(package=package, anchor=name.replace("_", "-"))


def _text(x: float, y: float, words: str, kind: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}"{f" class={kind!r}" if kind else ""}>{words}</text>'


def _path(course: str) -> str:
    return f'<path d="{course}"/>'


def _arrow(start: tuple[float, float], end: tuple[float, float]) -> str:
    length = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
    direction = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    return _path(f"M{start[0]:g} {start[1]:g} L{end[0]:g} {end[1]:g}") + _head(*end, *direction)


def _head(x: float, y: float, u: float, v: float) -> str:
    """A head that ends at (x, y) and points along (u, v)."""
    back = x - 7.0 * u, y - 7.0 * v
    return (
        f'<path class="head" d="M{x:g} {y:g} L{back[0] - 4.0 * v:g} {back[1] + 4.0 * u:g} '
        f'L{back[0] + 4.0 * v:g} {back[1] - 4.0 * u:g} Z"/>'
    )
