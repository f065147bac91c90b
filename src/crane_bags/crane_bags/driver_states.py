"""When commands reached the valves, as the driver told it in a bag."""

from pathlib import Path
from typing import Any

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_bags.storage import announced, messages, open_bag
from crane_bags.types import DRIVER_STATE, typestore

LETTING_THROUGH = ("STATE_ENABLED", "STATE_DEGRADED")


def let_through(path: Path | str, namespace: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) [ns] of driver/state, in order, and whether commands reached the valves (n,).

    Empty where the bag holds none, or one of another definition, which says less.
    """
    path, store, topic = Path(path), typestore(), DRIVER_STATE.within(namespace)
    found: list[tuple[int, bool]] = []
    with open_bag(path) as reader:
        count, hashes = announced(reader, topic.name)
        if count and not hashes - {store.hash_rihs01(topic.msgtype)}:
            kind = store.types[topic.msgtype]
            states = {getattr(kind, name) for name in LETTING_THROUGH}
            for _, _, data in messages(path, reader, [topic.name]):
                told: Any = store.deserialize_cdr(data, topic.msgtype)
                stamp = told.header.stamp
                found.append((stamp.sec * NANOSECONDS + stamp.nanosec, told.state in states))
    found.sort(key=lambda one: one[0])
    stamps = np.array([stamp for stamp, _ in found], dtype=np.int64)
    return stamps, np.array([through for _, through in found], dtype=bool)
