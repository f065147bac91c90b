"""What messages become in the view, whether they come from topics or from a bag."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from crane_bags.decoding import Table, decode, header_stamps
from crane_bags.types import (
    DIAGNOSTICS,
    DRIVER_STATE,
    JOINT_STATES,
    PARAMETER_ESTIMATE,
    POSITION_ESTIMATE,
    ROBOT_DESCRIPTION,
    SENSOR_FINDINGS,
    TIP_LOAD,
    TOPICS,
    VALVE_OUTPUT,
    Topic,
    typestore,
)
from crane_model.machine import Machine
from crane_viewer import layout, paths
from crane_viewer.scene import Scene3D
from crane_viewer.signals import signals
from crane_viewer.words import (
    Diagnostics,
    LogLine,
    driver_event,
    driver_page,
    estimate_page,
    finding_events,
    relative_deviations,
)

APPLICATION = "crane"
NOT_SHOWN = (
    ROBOT_DESCRIPTION,  # the machine's file gives it
    *(VALVE_OUTPUT, POSITION_ESTIMATE, TIP_LOAD),
)
SHOWN = tuple(one for one in TOPICS if one not in NOT_SHOWN)
"""The topics that are listened to."""


class View:
    """A recording of Rerun, filled from the CDR of messages, for a server, a file or both."""

    def __init__(
        self, machine: Machine, live: bool, server: str | None = None, file: Path | None = None
    ):
        """server: gRPC address of Rerun; live: messages come as they are sent."""
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
        """Show messages of a topic, with their times of reception [ns] for those without a stamp.

        `SerdeError` or `ValueError` where bytes are not of this type.
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
        """Whether the machine has been shown in a pose."""
        return self._scene.posed

    def flush(self) -> None:
        """Send what has been taken so far."""
        self._recording.flush()

    def finish(self) -> None:
        """Send what is left, and close the file."""
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
