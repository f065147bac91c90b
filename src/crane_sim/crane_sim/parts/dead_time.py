"""The dead time of pilot-operated valves: what was commanded is heard later."""

from collections.abc import Iterator

import numpy as np

from crane_sim.parts.parameters import SimulatedCrane, column

SHORTEST_S = 1e-6  # below which nothing is simulated


class DeadTime:
    """Commands of j valves, each in force `now` seconds after it was given; 0 before the first."""

    def __init__(self, parameters: SimulatedCrane):
        self._warm = column(parameters.valves, "dead_time")
        self._colder = column(parameters.valves, "cold_dead_time")
        self._warming = parameters.oil.warming
        self._none = not (self._warm + self._colder).any()
        joints = len(self._warm)
        self._given = [(-np.inf, np.zeros(joints))]  # s and commands (j,), the newest last

    def now(self, time: float) -> np.ndarray:
        """(j,) dead times [s] of a machine that has been running for a time [s]."""
        dead: np.ndarray = self._warm + self._colder * np.exp(-time / self._warming)
        return dead

    def heard(
        self, command: np.ndarray, begin: float, duration: float
    ) -> Iterator[tuple[float, np.ndarray]]:
        """How long, and which commands (j,), spools hear from `begin` [s] on, when `command` (j,)
        is given.
        """
        if self._none:
            yield duration, command
            return
        self._given.append((begin, command.copy()))
        dead, end = self.now(begin), begin + duration
        while len(self._given) > 1 and self._given[1][0] + dead.max() <= begin:
            self._given.pop(0)
        changes = [given + late for given, _ in self._given for late in dead]
        inside = sorted({at for at in changes if begin + SHORTEST_S < at < end - SHORTEST_S})
        for first, last in zip([begin, *inside], [*inside, end], strict=True):
            if last - first > SHORTEST_S:
                yield last - first, self._at(first + SHORTEST_S - dead)

    def _at(self, given: np.ndarray) -> np.ndarray:
        """(j,) what was in force, of each joint at its own time (j,) [s]."""
        in_force = self._given[0][1].copy()
        for time, command in self._given:
            later = given >= time
            in_force[later] = command[later]
        return in_force
