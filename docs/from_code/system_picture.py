"""Boxes and arrows as SVG: nodes and topics, commands and files, the decisions of `diagnose`."""

from collections.abc import Mapping, Sequence
from html import escape
from math import copysign
from typing import NamedTuple

LINE = 15.0  # px, height of a line of text
LETTER, MARGIN = 6.4, 16.0  # px: width of a letter, of both margins of a box
HEAD = 6.0  # px, length of an arrow head


class Box(NamedTuple):
    """Lines of text in a frame, by its centre [px]; a file or an answer has round corners."""

    x: float
    y: float
    lines: tuple[str, ...]
    file: bool = False

    @property
    def half(self) -> tuple[float, float]:
        """Half of width and height [px]."""
        longest = max(map(len, self.lines))
        return (LETTER * longest + MARGIN) / 2.0, (LINE * len(self.lines) + MARGIN) / 2.0


class Arrow(NamedTuple):
    """From one box to another, `shift` [px] aside; the label is at `at` of its length."""

    start: str
    end: str
    lines: tuple[str, ...] = ()
    shift: float = 0.0
    at: float = 0.5


LIVE = {
    "crane": Box(85, 200, ("crane", "or simulated_crane")),
    "driver": Box(345, 200, ("driver",)),
    "panel": Box(345, 50, ("panel",)),
    "control": Box(690, 50, ("trajectory", "jog, bringup")),
    "observers": Box(690, 200, ("position_estimator", "sensor_monitor", "payload_estimator")),
    "others": Box(690, 330, ("identification", "recorder, viewer")),
    "files": Box(345, 330, ("machine.yaml", "safety.yaml", "can.dbc, can.yaml"), True),
}
LIVE_ARROWS = (
    Arrow("crane", "driver", ("CAN: positions,", "pressures"), -16.0),
    Arrow("driver", "crane", ("CAN: valves",), -16.0),
    Arrow("panel", "driver", ("~/enable, ~/disable,", "~/emergency_stop, ~/reset_fault")),
    Arrow("control", "driver", ("/valve_command",), -13.0, 0.6),
    Arrow("driver", "control", ("/joint_states", "/driver/state"), -13.0, 0.75),
    Arrow("driver", "observers", ("/joint_states, /cylinder_pressures",), -14.0),
    Arrow("observers", "driver", ("/sensor_findings, /position_estimate",), -14.0),
    Arrow("observers", "control", ("/tip_load",)),
    Arrow("driver", "others", ("/joint_states", "/cylinder_pressures")),
    Arrow("files", "driver"),
)
OFFLINE = {
    "machine": Box(80, 50, ("machine.yaml",), True),
    "design": Box(230, 50, ("design",)),
    "trajectory": Box(390, 50, ("trajectory.yaml",), True),
    "run": Box(560, 50, ("run_excitation",)),
    "bag": Box(720, 50, ("bag",), True),
    "check": Box(720, 150, ("check_recording",)),
    "identify": Box(560, 150, ("identify",)),
    "model": Box(390, 150, ("model.yaml",), True),
    "diagnose": Box(560, 250, ("diagnose",)),
    "findings": Box(250, 250, ("findings.json",), True),
    "use": Box(
        110, 150, ("tune, trajectory", "estimate_positions", "estimate_payload, check_sensors")
    ),
}
OFFLINE_ARROWS = (
    Arrow("machine", "design"),
    Arrow("design", "trajectory"),
    Arrow("trajectory", "run"),
    Arrow("run", "bag"),
    Arrow("bag", "check"),
    Arrow("check", "identify"),
    Arrow("identify", "model"),
    Arrow("check", "diagnose"),
    Arrow("model", "diagnose"),
    Arrow("diagnose", "findings"),
    Arrow("findings", "design", ("--discriminate",), 0.0, 0.86),
    Arrow("model", "use"),
)
DIAGNOSIS = {
    "given": Box(90, 40, ("model, recordings",), True),
    "fit": Box(290, 40, ("fit the model,", "whiten the residual")),
    "select": Box(520, 40, ("select the effect", "that explains most")),
    "test": Box(520, 150, ("test it: chance, magnitude,", "other data, other effects")),
    "change": Box(270, 110, ("passed: add it to the model", "failed: exclude it")),
    "predict": Box(725, 130, ("predict the", "held-out recordings")),
    "found": Box(640, 245, ("do effects close the", "held-out error?")),
    "more": Box(410, 245, ("error left", "beyond noise?")),
    "rival": Box(200, 245, ("another effect", "as good?")),
    "named": Box(55, 245, ("named",), True),
    "and_more": Box(410, 330, ("named_and_more",), True),
    "ambiguous": Box(200, 330, ("ambiguous",), True),
    "error": Box(640, 330, ("error beyond", "noise?")),
    "unknown": Box(757, 330, ("unknown",), True),
    "show": Box(640, 415, ("would effects", "show?")),
    "none": Box(500, 415, ("none",), True),
    "insufficient": Box(640, 495, ("insufficient_data",), True),
}
DIAGNOSIS_ARROWS = (
    Arrow("given", "fit"),
    Arrow("fit", "select"),
    Arrow("select", "test"),
    Arrow("test", "change"),
    Arrow("change", "select"),
    Arrow("select", "predict", ("no gain", "beyond chance")),
    Arrow("predict", "found"),
    Arrow("found", "more", ("yes",)),
    Arrow("more", "and_more", ("yes",)),
    Arrow("more", "rival", ("no",)),
    Arrow("rival", "ambiguous", ("yes",)),
    Arrow("rival", "named", ("no",)),
    Arrow("found", "error", ("no",)),
    Arrow("error", "unknown", ("yes",)),
    Arrow("error", "show", ("no",)),
    Arrow("show", "none", ("yes",)),
    Arrow("show", "insufficient", ("no",)),
)


def pages() -> dict[str, str]:
    """The pictures that the pages on the system and on the diagnosis include."""
    made = {
        "system_live.txt": svg("Nodes, topics and services", LIVE, LIVE_ARROWS, 380),
        "system_files.txt": svg("Commands and files", OFFLINE, OFFLINE_ARROWS, 290),
        "diagnosis_chart.txt": svg("Decisions of diagnose", DIAGNOSIS, DIAGNOSIS_ARROWS, 525),
    }
    return {
        name: f'```{{raw}} html\n<div class="system">\n{drawn}\n</div>\n```\n'
        for name, drawn in made.items()
    }


def svg(title: str, boxes: Mapping[str, Box], arrows: Sequence[Arrow], height: float) -> str:
    """A picture of 800 px in width, in the colours of the page."""
    lines = "".join(_arrow(boxes[one.start], boxes[one.end], one) for one in arrows)
    labels = "".join(_label(boxes[one.start], boxes[one.end], one) for one in arrows)
    drawn = "".join(map(_box, boxes.values()))
    return (
        f'<svg viewBox="0 0 800 {height:.0f}" width="800" role="img" '
        f'aria-label="{escape(title)}">{lines}{drawn}{labels}</svg>'
    )


def _ends(start: Box, end: Box, shift: float) -> tuple[float, float, float, float]:
    """Where an arrow leaves the frame of one box and meets that of the other."""
    dx, dy = end.x - start.x, end.y - start.y
    length = (dx**2 + dy**2) ** 0.5
    aside = shift * -dy / length, shift * dx / length

    def border(box: Box, sign: float) -> tuple[float, float]:
        width, height = box.half
        reach = min(
            (width - sign * copysign(1.0, dx) * aside[0]) / abs(dx) if dx else float("inf"),
            (height - sign * copysign(1.0, dy) * aside[1]) / abs(dy) if dy else float("inf"),
        )
        return box.x + aside[0] + sign * dx * reach, box.y + aside[1] + sign * dy * reach

    return *border(start, 1.0), *border(end, -1.0)


def _arrow(start: Box, end: Box, arrow: Arrow) -> str:
    x, y, to_x, to_y = _ends(start, end, arrow.shift)
    length = ((to_x - x) ** 2 + (to_y - y) ** 2) ** 0.5
    ux, uy = (to_x - x) / length, (to_y - y) / length
    back_x, back_y = to_x - HEAD * ux, to_y - HEAD * uy
    side_x, side_y = -0.5 * HEAD * uy, 0.5 * HEAD * ux
    return (
        f'<path d="M{x:.1f} {y:.1f} L{back_x:.1f} {back_y:.1f}"/>'
        f'<path class="head" d="M{to_x:.1f} {to_y:.1f} L{back_x + side_x:.1f} '
        f'{back_y + side_y:.1f} L{back_x - side_x:.1f} {back_y - side_y:.1f} Z"/>'
    )


def _label(start: Box, end: Box, arrow: Arrow) -> str:
    x, y, to_x, to_y = _ends(start, end, arrow.shift)
    return _text(x + arrow.at * (to_x - x), y + arrow.at * (to_y - y), arrow.lines, "label")


def _box(box: Box) -> str:
    width, height = box.half
    kind, corner = ("file", height) if box.file else ("node", 3.0)
    return (
        f'<rect class="{kind}" x="{box.x - width:.1f}" y="{box.y - height:.1f}" '
        f'width="{2 * width:.1f}" height="{2 * height:.1f}" rx="{min(corner, 14.0):.0f}"/>'
        f"{_text(box.x, box.y, box.lines, 'name')}"
    )


def _text(x: float, y: float, lines: Sequence[str], kind: str) -> str:
    top = y - LINE * (len(lines) - 1) / 2.0
    return "".join(
        f'<text class="{kind}" x="{x:.1f}" y="{top + LINE * row:.1f}">{escape(line)}</text>'
        for row, line in enumerate(lines)
    )
