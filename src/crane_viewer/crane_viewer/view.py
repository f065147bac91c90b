"""Conversion of messages to the view, whether they come from topics or from a bag."""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from crane_bags.decoding import Table, decode, header_stamps
from crane_bags.types import (
    CYLINDER_PRESSURES,
    DIAGNOSTICS,
    DRIVER_STATE,
    GENERALIZED_FORCES,
    JOINT_REFERENCE,
    JOINT_STATES,
    PARAMETER_ESTIMATE,
    POSITION_ESTIMATE,
    ROBOT_DESCRIPTION,
    SENSOR_FINDINGS,
    TIP_LOAD,
    TOPICS,
    VALVE_COMMAND,
    VALVE_OUTPUT,
    Topic,
    typestore,
)
from crane_model.machine import Machine
from crane_viewer import layout, paths
from crane_viewer.scene import Scene3D

MEGAPASCAL = 1e6  # Pa

LEVEL_OK = 0  # diagnostic_msgs/DiagnosticStatus.level
LEVEL_NAMES = {LEVEL_OK: "INFO", 1: "WARN", 2: "ERROR", 3: "WARN"}  # 3: stale
SHOWN_DIGITS = 4

APPLICATION = "crane"
NOT_SHOWN = (
    ROBOT_DESCRIPTION,  # the machine's file gives it
    *(VALVE_OUTPUT, POSITION_ESTIMATE, TIP_LOAD),
)
SHOWN = tuple(topic for topic in TOPICS if topic not in NOT_SHOWN)
"""The topics that are listened to."""


class PlottedLines(NamedTuple):
    """Lines plotted at one place: stamps (n,) [ns], and (n, k) values of its k lines."""

    path: str
    stamps: np.ndarray
    values: np.ndarray


def signals(topic: Topic, table: Table, joints: tuple[str, ...]) -> Iterator[PlottedLines]:
    """The lines of messages of a topic; nothing of what is not known or of no joint of `joints`."""
    known = [(k, name) for k, name in enumerate(table.names) if name in joints]
    match topic.relative.rpartition("/")[2]:
        case JOINT_STATES.relative:
            for k, joint in known:
                yield from _present(paths.position(joint), table, table.fields["position"][:, k])
                yield from _present(
                    paths.measured_force(joint), table, table.fields["effort"][:, k]
                )
        case JOINT_REFERENCE.relative:
            for k, joint in known:
                yield from _present(paths.reference(joint), table, table.fields["position"][:, k])
        case CYLINDER_PRESSURES.relative:
            for k, joint in known:
                chambers = [table.fields[f"chamber_{chamber}"][:, k] for chamber in "ab"]
                values = np.stack(chambers, axis=1) / MEGAPASCAL
                yield from _present(paths.pressures(joint), table, values)
        case VALVE_COMMAND.relative:
            commands = np.zeros((len(table.stamp), len(joints)))  # what is not named is neutral
            for k, joint in known:
                commands[:, joints.index(joint)] = np.nan_to_num(table.fields["command"][:, k])
            yield from _present(paths.COMMANDS, table, commands)
        case GENERALIZED_FORCES.relative:
            for k, joint in known:
                yield from _present(
                    paths.predicted_force(joint), table, table.fields["predicted"][:, k]
                )


def _present(path: str, table: Table, values: np.ndarray) -> Iterator[PlottedLines]:
    values = values.reshape(len(table.stamp), -1)
    rows = np.isfinite(values).any(axis=1)
    if rows.any():
        yield PlottedLines(path, table.stamp[rows], values[rows])


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
    parts += [part for part in (state.cause, state.remedy) if part]
    return LogLine(level, f"{state.node}: {'; '.join(parts)}")


def driver_page(state: Any) -> str:
    """The same as Markdown."""
    lines = [f"# {state.text}"]
    lines += [line for line in (state.cause, f"*{state.remedy}*" if state.remedy else "") if line]
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
        """Changes with a DiagnosticArray; that all is well is reported only after trouble."""
        for status in message.status:
            level = status.level if isinstance(status.level, int) else status.level[0]
            now = (int(level), status.message)
            before = self._before.get(status.name, (LEVEL_OK, ""))
            self._before[status.name] = now
            if now != before and (now[0] != LEVEL_OK or before[0] != LEVEL_OK):
                yield LogLine(LEVEL_NAMES.get(now[0], "WARN"), f"{status.name}: {status.message}")


def finding_events(message: Any) -> Iterable[LogLine]:
    """Faulty sensors of a SensorFindings, a line each."""
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
        told = (
            f"{value:.{SHOWN_DIGITS}g} | {deviation:.2g} | {share:.1f} %" if known else "– | – | –"
        )
        rows.append(f"| {name} | {told} | {unit or '-'} |")
    return "\n".join(rows)


class View:
    """A recording of Rerun, filled from the CDR of messages, for a server, a file or both.

    Parameters
    ----------
    machine
        Machine that is shown.
    live
        Whether messages come as they are sent.
    server
        gRPC address of Rerun; None: no server.
    file
        File (.rrd) that is written; None: none.
    """

    def __init__(
        self, machine: Machine, live: bool, server: str | None = None, file: Path | None = None
    ):
        self._machine, self._store = machine, typestore()
        self._recording = rr.RecordingStream(APPLICATION)
        sinks: list[rr.GrpcSink | rr.FileSink] = [rr.GrpcSink(server)] if server else []
        if file:
            sinks.append(rr.FileSink(str(file)))
        plan = layout.blueprint(machine, live)
        self._recording.set_sinks(*sinks, default_blueprint=plan)
        self._scene = Scene3D(self._recording, machine)
        layout.style(self._recording, machine)
        self._diagnostics = Diagnostics()
        self._state = ""
        self._parameters: tuple[str, ...] = ()

    def take(self, topic: Topic, received: Sequence[int], messages: Sequence[bytes]) -> None:
        """Show messages of a topic.

        Parameters
        ----------
        topic
            Topic of the messages.
        received
            Time of reception of each message [ns], used if it has no stamp.
        messages
            Messages as they are sent (CDR).

        Raises
        ------
        SerdeError, ValueError
            If bytes are not of the type of the topic.
        """
        match topic:
            case _ if topic.msgtype == DRIVER_STATE.msgtype:
                self._each(topic, received, messages, self._driver)
            case _ if topic.msgtype == PARAMETER_ESTIMATE.msgtype:
                self._each(topic, received, messages, self._estimate)
            case _ if topic.msgtype == DIAGNOSTICS.msgtype:
                self._each(topic, received, messages, self._diagnosed)
            case _ if topic.msgtype == SENSOR_FINDINGS.msgtype:
                self._each(topic, received, messages, self._found)
            case _:
                self._lines(topic, decode(messages, topic.msgtype, self._store), received)

    @property
    def posed(self) -> bool:
        return self._scene.posed

    def flush(self) -> None:
        self._recording.flush()

    def finish(self) -> None:
        self.flush()
        self._recording.disconnect()

    def _lines(self, topic: Topic, table: Table, received: Sequence[int]) -> None:
        if not table.stamp.any():
            table = Table(table.names, np.array(received), table.present, table.fields)
        joints = self._machine.joint_names
        for path, stamps, values in signals(topic, table, joints):
            series = rr.Scalars.columns(scalars=values.ravel())
            if values.shape[1] > 1:
                series = series.partition([values.shape[1]] * len(values))
            self._recording.send_columns(path, [_time(stamps)], series)
        if topic.msgtype == JOINT_STATES.msgtype and set(joints) <= set(table.names):
            columns = [table.names.index(joint) for joint in joints]
            self._scene.show(table.stamp, table.fields["position"][:, columns])

    def _each(
        self, topic: Topic, received: Sequence[int], messages: Sequence[bytes], show: Any
    ) -> None:
        for at, data in zip(received, messages, strict=True):
            message = self._store.deserialize_cdr(data, topic.msgtype)
            stamp = int(header_stamps([message])[0]) or at
            self._recording.set_time(paths.TIMELINE, timestamp=np.datetime64(stamp, "ns"))
            show(message)

    def _driver(self, message: Any) -> None:
        told = driver_event(message)
        if told.text != self._state:
            self._state = told.text
            self._log(told)
            page = rr.TextDocument(driver_page(message), media_type=rr.MediaType.MARKDOWN)
            self._recording.log(paths.NOW, page)
            self._recording.log(paths.STATE, rr.StateChange(state=message.text))

    def _estimate(self, message: Any) -> None:
        names = tuple(message.name)
        if names != self._parameters:
            self._parameters = names
            self._recording.log(paths.UNCERTAINTY, rr.SeriesLines(names=names), static=True)
        page = rr.TextDocument(estimate_page(message), media_type=rr.MediaType.MARKDOWN)
        self._recording.log(paths.ESTIMATE, page)
        self._recording.log(paths.UNCERTAINTY, rr.Scalars(relative_deviations(message)))

    def _diagnosed(self, message: Any) -> None:
        for event in self._diagnostics.events(message):
            self._log(event)

    def _found(self, message: Any) -> None:
        for event in finding_events(message):
            self._log(event)

    def _log(self, event: LogLine) -> None:
        self._recording.log(paths.EVENTS, rr.TextLog(event.text, level=event.level))


def _time(stamps: np.ndarray) -> rr.TimeColumn:
    return rr.TimeColumn(paths.TIMELINE, timestamp=stamps.astype("datetime64[ns]"))
