"""A controller around another one."""

import numpy as np

from crane_trajectory.control.interface import ControlCondition, Controller, SensorReading, Wanted


class WrappedController:
    """A controller that does all as the `inner` one does; what differs, another class overrides."""

    def __init__(self, inner: Controller):
        self.inner = inner

    @property
    def preview(self) -> float:
        """As the inner one has it [s]."""
        return self.inner.preview

    @property
    def by_model(self) -> np.ndarray:
        """As the inner one has it (j,)."""
        return self.inner.by_model

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """As the inner one has them."""
        return self.inner.conditions

    def start(self, command: np.ndarray) -> None:
        """As the inner one."""
        self.inner.start(command)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As the inner one (j,)."""
        return self.inner.command(dt, reading, wanted)
