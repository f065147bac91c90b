"""What sensors and valves see of a machine that moves, whatever moves it."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from crane_model.machine import Machine
from crane_sim.effects.form import Planted
from crane_sim.parts.parameters import StandIn


class MachineInMotion(Protocol):
    """A machine of j joints, from the base to the tip."""

    @property
    def machine(self) -> Machine:
        """Its data."""

    @property
    def q(self) -> np.ndarray:
        """(j,) rad, m."""

    @property
    def pressure_a(self) -> np.ndarray:
        """(j,) Pa."""

    @property
    def pressure_b(self) -> np.ndarray:
        """(j,) Pa."""

    @property
    def supply_pressure(self) -> float:
        """Pa."""

    @property
    def tank_pressure(self) -> float:
        """Pa."""

    def advance(self, command: np.ndarray, duration: float) -> None:
        """Run for `duration` [s] with spool commands (j,) in -1..1; positive moves a joint up."""

    def leak(self, passed: np.ndarray) -> None:
        """From now on pistons let (j,) more oil through, m3/(s Pa); `RangeError` if none can."""


class RecordedMachine(MachineInMotion, Protocol):
    """One of which recordings tell what truly happened; k hidden effects act in it."""

    @property
    def parameters(self) -> StandIn:
        """What it was made with; its sensors are those of recordings."""

    @property
    def time(self) -> float:
        """Since the machine was started [s]."""

    @property
    def v(self) -> np.ndarray:
        """(j,) rad/s, m/s."""

    @property
    def acceleration(self) -> np.ndarray:
        """(j,) rad/s2, m/s2."""

    @property
    def hidden_count(self) -> int:
        """k."""

    @property
    def hidden_force(self) -> np.ndarray:
        """(k, j) what each hidden effect asks of the drives [N m, N]."""

    @property
    def hidden_flow(self) -> np.ndarray:
        """(k, j) what flows more into chamber A for each hidden effect [m3/s]."""


Build = Callable[[np.ndarray, Sequence[Planted], float], RecordedMachine]
"""Makes a machine that rests at (j,) [rad, m], with hidden effects, that has run for a time [s]."""
