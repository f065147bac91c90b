"""Bags as others write them: rosbags with either storage, and the mcap library."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Qos
from rosbags.rosbag2 import StoragePlugin, Writer

from crane_bags import typestore
from crane_bags.types import JOINT_STATES

Message = tuple[int, bytes]  # log time [ns], CDR


@pytest.fixture(scope="session")
def joint_state() -> Callable[..., bytes]:
    """CDR of a JointState, serialised by rosbags."""
    store = typestore()
    types = store.types

    def serialize(
        stamp: int,
        names: Sequence[str],
        position: Sequence[float],
        velocity: Sequence[float] = (),
        effort: Sequence[float] = (),
    ) -> bytes:
        sec, nanosec = divmod(stamp, 10**9)
        time = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        message = types[JOINT_STATES.msgtype](
            header=types["std_msgs/msg/Header"](stamp=time, frame_id="base"),
            name=list(names),
            position=np.array(position, dtype=float),
            velocity=np.array(velocity, dtype=float),
            effort=np.array(effort, dtype=float),
        )
        return bytes(store.serialize_cdr(message, JOINT_STATES.msgtype))

    return serialize


@pytest.fixture
def write_bag(tmp_path: Path) -> Callable[..., Path]:
    """Write messages of one topic as a bag, through rosbags."""

    def write(
        messages: Sequence[Message],
        storage: StoragePlugin = StoragePlugin.MCAP,
        name: str = "bag",
        topic: str = JOINT_STATES.name,
        msgtype: str = JOINT_STATES.msgtype,
        qos: Sequence[Qos] = (),
        **definition: Any,
    ) -> Path:
        path = tmp_path / name
        with Writer(path, version=9, storage_plugin=storage) as writer:
            connection = writer.add_connection(
                topic, msgtype, typestore=typestore(), offered_qos_profiles=qos, **definition
            )
            for log_time, data in messages:
                writer.write(connection, log_time, data)
        return path

    return write
