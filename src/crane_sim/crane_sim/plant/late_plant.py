"""A plant behind a bus: commands come into force some time after they were given."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.integrate import quad

from crane_model.machine import Machine
from crane_sim.effects.form import Planted
from crane_sim.parts.parameters import StandIn
from crane_sim.plant.plant import Plant

DELAY, SPREAD = 0.005, 0.010  # s, of the bus and the computers of the live suite
SHORTEST = 1e-6  # s, below which nothing is simulated


def mean_delay(period: float, delay: float = DELAY, spread: float = SPREAD) -> float:
    """Of a command that is given every `period` s [s].

    A command waits for those before it, so the mean lies above `delay` + `spread` / 2: of the
    latest of `spread` U_j - j `period`, U_j evenly drawn from 0 to 1.
    """
    before = period * np.arange(np.ceil(spread / period))

    def later_than(wait: float) -> float:
        return float(1.0 - np.prod(np.minimum((wait + before) / spread, 1.0)))

    kinks = (spread - before)[1:]
    return delay + float(quad(later_than, 0.0, spread, points=kinks)[0])


class LatePlant(Plant):
    """Each command is in force `delay` s and up to `spread` s more, evenly drawn, after it was
    given; a bus keeps the order. What was given stays in force until then.
    """

    def __init__(
        self,
        parameters: StandIn,
        machine: Machine,
        q0: np.ndarray,
        planted: Sequence[Planted] = (),
        delay: float = DELAY,
        spread: float = SPREAD,
        seed: int = 0,
    ):
        """As `Plant` has it; delays are drawn by `seed`."""
        super().__init__(parameters, machine, q0, planted)
        self._delay, self._spread = delay, spread
        self._rng = np.random.default_rng([seed, 7])
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._in_force = np.zeros(len(machine.joint_names))

    def advance(self, command: np.ndarray, duration: float) -> None:
        """As `Plant` has it; `command` (j,) is given now."""
        begin = self.time
        due = begin + self._delay + self._rng.uniform(0.0, self._spread)
        if self._waiting:
            due = max(due, self._waiting[-1][0])
        self._waiting.append((due, np.array(command, dtype=float)))
        while self._waiting and self._waiting[0][0] < begin + duration:
            due, following = self._waiting.popleft()
            self._run(due - self.time)
            self._in_force = following
        self._run(begin + duration - self.time)

    def _run(self, duration: float) -> None:
        if duration > SHORTEST:
            super().advance(self._in_force, duration)
