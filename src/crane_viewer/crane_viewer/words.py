"""What is told in words: the driver's state, faults as they come, and Θ with its σ."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

OK = 0  # diagnostic_msgs/DiagnosticStatus.level
LEVELS = {OK: "INFO", 1: "WARN", 2: "ERROR", 3: "WARN"}  # 3: stale
DIGITS = 4


class LogLine(NamedTuple):
    """A line of the log."""

    level: str  # INFO, WARN, ERROR
    text: str


def driver_event(state: Any) -> LogLine:
    """A DriverState as a line: what it is, why, and what to do."""
    match state.state:
        case state.STATE_FAULT | state.STATE_EMERGENCY_STOP:
            level = "ERROR"
        case state.STATE_DEGRADED:
            level = "WARN"
        case _:
            level = "INFO"
    parts = [state.text]
    if state.source:
        parts[0] += f" ({state.source})"
    parts += [one for one in (state.cause, state.remedy) if one]
    return LogLine(level, f"{state.node}: {'; '.join(parts)}")


def driver_page(state: Any) -> str:
    """The same as Markdown."""
    lines = [f"# {state.text}"]
    lines += [one for one in (state.cause, f"*{state.remedy}*" if state.remedy else "") if one]
    if state.further_faults:
        lines.append(f"{state.further_faults} further faults, mostly its consequences")
    if state.commands_refused:
        lines.append(f"{state.commands_refused} commands refused; the last: {state.last_refusal}")
    return "\n\n".join(lines)


class Diagnostics:
    """Statuses on /diagnostics: a line whenever one becomes better or worse."""

    def __init__(self) -> None:
        self._before: dict[str, tuple[int, str]] = {}

    def events(self, message: Any) -> Iterable[LogLine]:
        """What has changed with a DiagnosticArray; that all is well is told only after trouble."""
        for status in message.status:
            level = status.level if isinstance(status.level, int) else status.level[0]
            now = (int(level), status.message)
            before = self._before.get(status.name, (OK, ""))
            self._before[status.name] = now
            if now != before and (now[0] != OK or before[0] != OK):
                yield LogLine(LEVELS.get(now[0], "WARN"), f"{status.name}: {status.message}")


def finding_events(message: Any) -> Iterable[LogLine]:
    """Sensors that lie, a line each, of a SensorFindings."""
    for sensor, kind, what in zip(message.sensor, message.kind, message.what_to_do, strict=True):
        yield LogLine("WARN", f"{sensor}: {kind}; {what}")


def relative_deviations(estimate: Any) -> list[float]:
    """100 σ / |Θ| [%] of each parameter of a ParameterEstimate; nan where it is not determined."""
    return [
        100.0 * deviation / abs(value) if value and math.isfinite(deviation) else math.nan
        for value, deviation in zip(estimate.value, estimate.std_dev, strict=True)
    ]


def estimate_page(estimate: Any) -> str:
    """A ParameterEstimate as a table in Markdown."""
    rows = [f"**{estimate.model}**, {estimate.samples} samples", ""]
    rows += ["| parameter | Θ | σ | σ/abs(Θ) | unit |", "|---|---:|---:|---:|---|"]
    shares = relative_deviations(estimate)
    for name, value, deviation, share, unit in zip(
        estimate.name, estimate.value, estimate.std_dev, shares, estimate.unit, strict=True
    ):
        known = math.isfinite(deviation) and math.isfinite(value)
        told = f"{value:.{DIGITS}g} | {deviation:.2g} | {share:.1f} %" if known else "– | – | –"
        rows.append(f"| {name} | {told} | {unit or '-'} |")
    return "\n".join(rows)
