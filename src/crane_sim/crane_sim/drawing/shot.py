"""What a film shows of a bag: where the joints were at each picture, and where they should be."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_bags.namespaces import namespace_of
from crane_bags.reader import TopicData, read_topics
from crane_bags.types import JOINT_REFERENCE, JOINT_STATES
from crane_model.errors import DataError
from crane_model.machine import Machine

LEAST_WAY = 0.02  # rad, m: a joint that has moved less is not worth a curve


class Shot(NamedTuple):
    """n pictures of j joints, from the base to the tip."""

    time: np.ndarray  # (n,) s, from the first
    position: np.ndarray  # (n, j) rad, m
    reference: np.ndarray  # (n, j) rad, m; NaN where there was none

    @property
    def moved(self) -> list[int]:
        """The joints that moved, by their columns; all of them if none did."""
        way = np.ptp(self.position, axis=0)
        return [int(i) for i in np.flatnonzero(way > LEAST_WAY)] or list(range(way.size))


def shot(bag: Path, machine: Machine, begin: float, length: float, rate: float) -> Shot:
    """`length` seconds of a bag from `begin`, `rate` pictures a second; fewer where it ends before.

    begin: s from the first joint states of the bag. `DataError` if it holds none then.
    """
    namespace = namespace_of(bag)
    states_topic = JOINT_STATES.within(namespace)
    reference_topic = JOINT_REFERENCE.within(namespace)
    read = read_topics(bag, [states_topic], [reference_topic])
    states = read[states_topic.name].select(machine.joint_names)
    start = int(states.stamp[0])
    seconds = (int(states.stamp[-1]) - start) * 1e-9
    if not 0.0 <= begin < seconds:
        raise DataError(
            f"{bag}: its joint states last {seconds:.1f} s, but the film is to begin at "
            f"{begin:g} s; let it begin before"
        )
    time = np.arange(begin, min(begin + length, seconds), 1 / rate)
    position = _at(time, states, start, machine)
    if not np.isfinite(position).all():
        lost = [name for name, q in zip(machine.joint_names, position.T, strict=True)
                if not np.isfinite(q).all()]  # fmt: skip
        raise DataError(f"{bag}: {', '.join(lost)} was not measured; film a bag in which it was")
    # a reading may lie beyond the limits, by its noise; the linkages are drawn within them
    limits = [machine.limits[joint] for joint in machine.joint_names]
    drawn = position.clip(
        [one.position_min for one in limits], [one.position_max for one in limits]
    )
    reference = np.full_like(position, np.nan)
    if told := read.get(reference_topic.name):
        reference = _at(time, told, start, machine)
    return Shot(time - begin, drawn, reference)


def _at(time: np.ndarray, told: TopicData, start: int, machine: Machine) -> np.ndarray:
    """(n, j) positions at times [s], those between messages interpolated; NaN outside of them."""
    values = np.full((time.size, len(machine.joint_names)), np.nan)
    when = (told.stamp - start) * 1e-9
    for column, joint in enumerate(machine.joint_names):
        if joint not in told.names:
            continue
        position = told.fields["position"][:, told.names.index(joint)]
        known = np.isfinite(position)
        if known.any():
            values[:, column] = np.interp(
                time, when[known], position[known], left=np.nan, right=np.nan
            )
    return values
