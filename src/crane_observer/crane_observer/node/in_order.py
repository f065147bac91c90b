"""Messages of several topics in the order of their stamps, whatever delay each topic has."""

from typing import Generic, NamedTuple, TypeVar

M = TypeVar("M")
LONGEST = 100_000_000  # ns, that one topic is waited for when others have gone on, unless told


class Stamped(NamedTuple, Generic[M]):
    """A message, its stamp [ns] and the place of its topic."""

    stamp: int
    topic: int
    message: M


class InOrder(Generic[M]):
    """Holds messages back until every topic that talks has come as far, or is late by `longest` ns.

    A valve command that arrives a moment after the pressures that it made is so put before them.
    """

    def __init__(self, longest: int = LONGEST) -> None:
        self._longest = longest
        self._held: list[Stamped[M]] = []
        self._newest: dict[int, int] = {}  # ns, by topic

    def add(self, stamp: int, topic: int, message: M) -> None:
        """It has come."""
        self._held.append(Stamped(stamp, topic, message))
        self._newest[topic] = max(stamp, self._newest.get(topic, stamp))

    def take(self) -> list[Stamped[M]]:
        """Those whose turn it is, the oldest first."""
        if not self._held:
            return []
        latest = max(self._newest.values())
        talking = [newest for newest in self._newest.values() if latest - newest < self._longest]
        until = min(talking)
        self._held.sort(key=lambda one: one[:2])
        count = sum(one.stamp <= until for one in self._held)
        taken, self._held = self._held[:count], self._held[count:]
        return taken
