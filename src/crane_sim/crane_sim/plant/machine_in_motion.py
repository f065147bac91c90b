"""What sensors and valves see of a machine that moves, whatever moves it."""

from typing import Protocol

import numpy as np

from crane_model.machine import Machine


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
