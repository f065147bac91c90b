"""A plant behind a bus: commands come into force some time after they were given."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from crane_model.machine import Machine
from crane_sim.effects.form import Planted
from crane_sim.parts.parameters import StandIn
from crane_sim.plant.plant import Plant

DELAY, SPREAD = 0.005, 0.010  # s, of the bus and the computers of the live suite
MEAN_DELAY = DELAY + 0.5 * SPREAD  # s, but for what keeping their order adds
SHORTEST = 1e-6  # s, below which nothing is simulated


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
