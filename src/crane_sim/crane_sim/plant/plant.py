"""The plant: valves, oil, cylinders, bodies and friction, stepped together."""

import math
from collections.abc import Sequence

import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_sim.effects.form import Planted
from crane_sim.effects.kernel import act
from crane_sim.effects.working import packed
from crane_sim.parts.constants import pack
from crane_sim.parts.cylinders import set_lengths_and_levers
from crane_sim.parts.parameters import StandIn
from crane_sim.parts.rigid_bodies import mass_and_bias
from crane_sim.parts.state import State, at_rest, room
from crane_sim.plant.stepping import advance


class Plant:
    """The stand-in machine in motion.

    It starts at rest at `q0` (j,) with centred spools and chamber pressures that carry gravity; the
    two pressures of a cylinder then add up to the supply pressure where that is possible, as a
    valve with equal metering edges leaves them. Nothing in it is random: noise is in the sensors.
    Of `planted`, faults of sensors have no part in it.
    """

    def __init__(
        self,
        parameters: StandIn,
        machine: Machine,
        q0: np.ndarray,
        planted: Sequence[Planted] = (),
        running: float = 0.0,
    ):
        """`running` [s] is for how long the machine has been on: what warms up or wears goes on
        from there. `RangeError` if q0 is outside Table 2 or gravity exceeds what the pump can hold.
        """
        _check_pose(machine, q0)
        self.parameters, self.machine = parameters, machine
        self.time = running  # s since the machine was started
        self.tank_pressure = machine.hydraulics.tank_pressure
        self._constants = pack(parameters, machine)
        self._leakage = self._constants.cylinders["leakage"].copy()
        # None is compiled apart: no cost where none hides
        self._hidden = packed(planted, machine, running)
        self._scratch = room(self._constants.friction)
        self._step = parameters.step
        self._state = self._at_rest(np.array(q0, dtype=float))

    def advance(self, command: np.ndarray, duration: float) -> None:
        """Run for `duration` [s] with spool commands (j,) in -1..1; positive moves a joint up.

        Steps are equal and at most `parameters.step`. `RangeError` if a command is not finite, or
        the crane was driven out of the range in which its linkages can be assembled.
        """
        command = np.ascontiguousarray(command, dtype=float)
        if not all(map(math.isfinite, command.tolist())):  # np.isfinite costs more for a few joints
            raise RangeError(f"valve command {command}: must be finite, in -1..1 for each joint")
        count = max(1, math.ceil(duration / self.parameters.step - 1e-6))
        self._step = duration / count
        advance(
            self._constants, self._hidden, self._state, self._scratch, command, self._step, count
        )
        self.time += duration
        if not all(map(math.isfinite, self._state.q.tolist())):
            raise RangeError(
                f"plant: a linkage was forced open before t = {self.time:.4f} s; stiffen the end "
                "stops (cylinders.*.stop_stiffness) or shorten the step"
            )

    def leak(self, passed: np.ndarray) -> None:
        """From now on pistons let `passed` (j,) more oil through than the stand-in's, m3/(s Pa)."""
        self._constants.cylinders["leakage"] = self._leakage + passed

    def set_magnitude(self, k: int, magnitude: float, *shape: float) -> None:
        """From now on, effect k of those planted that act in the plant has this magnitude, and this
        `shape`, as far as it is given.
        """
        if not 0 <= k < self.hidden_count or self._hidden is None:
            raise RangeError(f"plant: no hidden effect {k}; it has {self.hidden_count}")
        self._hidden.value[k, : 1 + len(shape)] = magnitude, *shape

    @property
    def q(self) -> np.ndarray:
        """(j,) coordinates [rad, m]; this and the others from the base to the tip."""
        return self._state.q.copy()

    @property
    def v(self) -> np.ndarray:
        """(j,) velocities [rad/s, m/s]; exactly 0 where a joint sticks by (13)."""
        return self._state.v.copy()

    @property
    def acceleration(self) -> np.ndarray:
        """(j,) mean over the last step [rad/s2, m/s2]; 0 before the first."""
        return (self._state.v - self._scratch.before) / self._step

    @property
    def hidden_count(self) -> int:
        """How many hidden effects act in the plant."""
        return 0 if self._hidden is None else len(self._hidden.law)

    @property
    def hidden_flow(self) -> np.ndarray:
        """(k, j) what flows more into chamber A for each hidden effect [m3/s]."""
        return (
            np.zeros((0, len(self._state.q))) if self._hidden is None else self._hidden.flow.copy()
        )

    @property
    def hidden_force(self) -> np.ndarray:
        """(k, j) what each hidden effect asked of the drives in the last step [N m, N]."""
        return (
            np.zeros((0, len(self._state.q))) if self._hidden is None else self._hidden.force.copy()
        )

    @property
    def pressure_a(self) -> np.ndarray:
        """(j,) pressures of chambers A [Pa]."""
        return self._state.actuators["p_a"].copy()

    @property
    def pressure_b(self) -> np.ndarray:
        """(j,) pressures of chambers B [Pa]."""
        return self._state.actuators["p_b"].copy()

    @property
    def spool(self) -> np.ndarray:
        """(j,) spool positions in -1..1; positive extends the cylinder."""
        return self._state.actuators["spool"].copy()

    @property
    def supply_pressure(self) -> float:
        """Pressure of the supply line [Pa]."""
        return float(self._state.supply[0])

    def _at_rest(self, q: np.ndarray) -> State:
        constants, scratch = self._constants, self._scratch
        state = at_rest(q, self.machine.hydraulics.supply_pressure)
        actuators = state.actuators
        set_lengths_and_levers(constants.linkages, q, actuators)
        mass_and_bias(constants.chain, q, state.v, scratch.mass, scratch.bias)
        if self._hidden is not None:
            act(self._hidden, constants, state, scratch, self._step)
        tank, supply = self.tank_pressure, self.machine.hydraulics.supply_pressure
        area_a, area_b = constants.cylinders["area_a"], constants.cylinders["area_b"]
        piston = (scratch.bias - scratch.force) / actuators["lever"]
        p_a = (piston + area_b * (supply + tank)) / (area_a + area_b)
        p_a = np.clip(p_a, np.maximum(tank, (piston + area_b * tank) / area_a), supply)
        p_b = (area_a * p_a - piston) / area_b
        held = (tank <= p_a) & (p_a <= supply) & (tank <= p_b) & (p_b <= supply)
        if not held.all():
            i = int(np.argmin(held))
            raise RangeError(
                f"{self.machine.joint_names[i]}: at {np.round(q, 4).tolist()} gravity needs "
                f"{piston[i]:.0f} N (N m of a motor), more than the supply pressure of "
                f"{supply:.4g} Pa can hold; start from another pose"
            )
        actuators["p_a"], actuators["p_b"] = p_a, p_b
        return state


def _check_pose(machine: Machine, q0: np.ndarray) -> None:
    for i, joint in enumerate(machine.joint_names):
        limits = machine.limits[joint]
        if not limits.position_min <= q0[i] <= limits.position_max:
            raise RangeError(
                f"{joint}: the plant cannot start at {q0[i]:.6g} {machine.units[joint]}, outside "
                f"[{limits.position_min}, {limits.position_max}] of Table 2"
            )
