"""The twin of a crane, its identified model, in place of the stand-in's plant."""

import numpy as np

from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.twin import Twin


class TwinPlant:
    """A `MachineInMotion`. Joints whose hydraulics the model lacks stand where they are.

    The lag of the loop is left out of the valves: what carries the commands here has one of its
    own.
    """

    def __init__(self, model: Model, machine: Machine, q0: np.ndarray):
        """At rest at q0 (j,). `ConfigurationError` if the model is of another machine, or lacks
        its hydraulics; `RangeError` if q0 is outside the limits or cannot be held.
        """
        if model.machine is None or model.machine.model_dump() != machine.model_dump():
            raise ConfigurationError(
                f"model '{model.name}' was not identified with the machine {machine.name}, as its "
                "file has it now; name its machine by --machine, or identify it again"
            )
        self.machine = machine
        self._columns = [machine.index(joint) for joint in model.joints]
        self._twin = Twin(model, q0[np.newaxis, self._columns])
        self._q = np.array(q0, dtype=float)
        self.tank_pressure = machine.hydraulics.tank_pressure

    @property
    def standing(self) -> tuple[str, ...]:
        """The joints that do not move."""
        return tuple(one for one in self.machine.joint_names if one not in self._twin.joints)

    def advance(self, command: np.ndarray, duration: float) -> None:
        """As `MachineInMotion` has it."""
        self._twin.advance(np.asarray(command)[np.newaxis, self._columns], duration)

    def leak(self, passed: np.ndarray) -> None:
        """As `MachineInMotion` has it: none can."""
        if passed.any():
            raise RangeError("the pistons of a twin leak as its model says: it cannot be changed")

    @property
    def q(self) -> np.ndarray:
        """(j,) rad, m."""
        now = self._q.copy()
        now[self._columns] = self._twin.position[0]
        return now

    @property
    def pressure_a(self) -> np.ndarray:
        """(j,) Pa; half of the supply's where the joint stands."""
        return self._chambers(0)

    @property
    def pressure_b(self) -> np.ndarray:
        """(j,) Pa; half of the supply's where the joint stands."""
        return self._chambers(1)

    @property
    def supply_pressure(self) -> float:
        """Pa."""
        return float(self._twin.pressures[2][0])

    def _chambers(self, chamber: int) -> np.ndarray:
        found = np.full(len(self._q), 0.5 * self.supply_pressure)
        found[self._columns] = self._twin.pressures[chamber][0]
        return found
