"""From a bag to a log."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_bags.namespaces import namespace_of
from crane_bags.reader import TopicData, read_topics
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
    VALVE_OUTPUT,
    Topic,
)
from crane_identification.data.log import Log, Signal
from crane_model.errors import DataError
from crane_model.progress_bar import Progress, silent

SLEW = "slew"


def read_bag(
    path: Path | str,
    joints: Sequence[str],
    progress: Progress = silent,
    namespace: str | None = None,
) -> Log:
    """The signals of `joints` in a bag of either storage, recorded by anyone.

    Positions are required, and chamber pressures or, in their place, the effort of /joint_states,
    which is the generalized force; topics that are not there are named in `missing`. Without
    /valve_command, as in a recording of a driver that only listens, commands are those of
    /valve_output. The topics are those in `namespace` (None: the one that the bag holds).
    `DataError` names bag, topic and remedy (see `crane_bags.reader`).
    """
    namespace = namespace_of(path) if namespace is None else namespace
    joint_states = JOINT_STATES.within(namespace)
    may_lack = tuple(
        topic.within(namespace) for topic in (CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE)
    )
    cylinder_pressures, valve_command, joint_reference = may_lack
    valve_output = VALVE_OUTPUT.within(namespace)
    topics = read_topics(path, (joint_states,), (*may_lack, valve_output), progress)
    if valve_command.name not in topics:
        valve_command = valve_output
    states = topics[joint_states.name].select(joints)
    pressures = topics.get(cylinder_pressures.name)
    pressures = pressures and pressures.select(joints)
    if pressures is None and np.isnan(states.fields["effort"]).all():
        raise DataError(
            f"{path}: no topic {cylinder_pressures.name}, and {joint_states.name} holds no effort "
            f"(generalized force) of {', '.join(joints)} in its place; record one of them"
        )
    command = _selected(topics, valve_command, joints)
    reference = _selected(topics, joint_reference, joints)
    slew = None if SLEW in joints else _selected(topics, joint_states, [SLEW])
    slewed = None if SLEW in joints else _selected(topics, valve_command, [SLEW])
    start = int(states.stamp[0])

    def signal(data: TopicData, field: str) -> Signal:
        time, received = (data.stamp - start) / NANOSECONDS, (data.log_time - start) / NANOSECONDS
        known = data.stamped_by == "header"  # else the stamps are the log times
        by_recorder = received if known else None
        return Signal(time, data.fields[field], data.topic, by_recorder, data.set_back)

    def signal_if_any(data: TopicData | None, field: str) -> Signal | None:
        if data is None or np.isnan(data.fields[field]).all():
            return None
        return signal(data, field)

    effort = () if pressures else (f"the effort of {joint_states.name} is taken as the force",)
    used = [data for data in (states, pressures, command, reference) if data]
    return Log(
        source=str(path),
        joints=tuple(joints),
        start=start,
        position=signal(states, "position"),
        velocity=signal_if_any(states, "velocity"),
        force=None if pressures else signal(states, "effort"),
        pressure_a=signal(pressures, "chamber_a") if pressures else None,
        pressure_b=signal(pressures, "chamber_b") if pressures else None,
        supply_pressure=signal_if_any(pressures, "supply"),
        tank_pressure=signal_if_any(pressures, "tank"),
        slew_position=_first_column(signal_if_any(slew, "position")),
        slew_command=_first_column(signal_if_any(slewed, "command")),
        command=signal_if_any(command, "command"),
        reference_position=signal_if_any(reference, "position"),
        reference_velocity=signal_if_any(reference, "velocity"),
        reference_acceleration=signal_if_any(reference, "acceleration"),
        missing=tuple(
            topic.name
            for topic, data in zip(may_lack, (pressures, command, reference), strict=True)
            if data is None
        ),
        unstamped=tuple(data.topic for data in used if data.stamped_by == "log time"),
        notes=(*(note for data in used for note in data.notes), *effort),
    )


def _selected(
    topics: Mapping[str, TopicData], topic: Topic, names: Sequence[str]
) -> TopicData | None:
    """The columns `names` of an optional topic, or None where it does not name them all."""
    data = topics.get(topic.name)
    return data.select(names) if data and set(names) <= set(data.names) else None


def _first_column(signal: Signal | None) -> Signal | None:
    return signal and replace(signal, value=signal.value[:, 0])
