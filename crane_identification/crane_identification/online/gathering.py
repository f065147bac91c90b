"""Quantities that stand in messages of several topics, brought together by their stamps."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from crane_bags.fields import Place
from crane_identification.data.sources import Source
from crane_identification.online.matching import Matcher


class Gathered(NamedTuple):
    """One number of each source [SI] at `stamp` [ns]."""

    stamp: int
    values: np.ndarray  # (s,)


class Gathering:
    """Numbers of `sources` out of messages, at the stamps of the first topic that they name.

    Those of the other topics are interpolated to them, where their messages are at most
    `largest_gap` [ns] apart; what comes out depends on stamps alone.
    """

    def __init__(self, sources: Sequence[Source], largest_gap: int):
        readings = [(i, one) for i, source in enumerate(sources) for one in source.readings]
        self.topics = tuple(dict.fromkeys(one.stream for _, one in readings))
        by_topic = [[pair for pair in readings if pair[1].stream == t] for t in self.topics]
        self._readings = [[(one, Place(*one.cell)) for _, one in pairs] for pairs in by_topic]
        self._adds_to = np.array([i for pairs in by_topic for i, _ in pairs])
        self._count = len(sources)
        # each joins one more topic to those before it
        self._stages = [Matcher(largest_gap) for _ in self.topics[1:]]

    def add(self, topic: str, stamp: int, message: Any) -> list[Gathered]:
        """What a message of one of the topics completes; `ValueError` if a field is missing."""
        place = self.topics.index(topic)
        numbers = np.array(
            [float(one.in_si(np.array(at.number(message)))) for one, at in self._readings[place]]
        )
        if place == 0:
            complete = [(stamp, numbers)]
        else:
            stage = self._stages[place - 1]
            complete = [
                (one.stamp, np.concatenate(one[1:])) for one in stage.add_pressure(stamp, numbers)
            ]
        for stage in self._stages[place:]:
            complete = [
                (matched.stamp, np.concatenate(matched[1:]))
                for at, values in complete
                for matched in stage.add_position(at, values)
            ]
        return [
            Gathered(at, np.bincount(self._adds_to, values, self._count)) for at, values in complete
        ]
