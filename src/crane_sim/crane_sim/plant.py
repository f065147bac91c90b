"""The plant: valves, oil, cylinders, bodies and friction, stepped together in compiled code."""

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from crane_model.errors import RangeError
from crane_model.machine import JOINT_UNITS, JOINTS, Machine
from crane_sim.constants import Constants, pack
from crane_sim.cylinders import set_lengths_and_levers, stop_force
from crane_sim.friction import step_lugre, step_set_valued
from crane_sim.hidden.flow import leak, meter, note_softness, softness
from crane_sim.hidden.form import Planted
from crane_sim.hidden.kernel import act, settle
from crane_sim.hidden.working import Hidden, work
from crane_sim.hydraulics import (
    chamber_step,
    opening,
    port_flow,
    pump_flow,
    relief_flow,
    spool_step,
)
from crane_sim.parameters import StandIn
from crane_sim.rigid_bodies import mass_and_bias
from crane_sim.state import ACTUATOR, Scratch, State


@njit(cache=True, error_model="numpy")
def _generalized_forces(constants: Constants, state: State, force: np.ndarray) -> None:
    """What drives the joints, friction and inertia apart: (4,) N m, N.

    What hidden effects add to it, and to the bodies and the friction, is in `hidden.kernel`.
    """
    for i in range(4):
        cylinder, actuator = constants.cylinders[i], state.actuators[i]
        piston = cylinder.area_a * actuator.p_a - cylinder.area_b * actuator.p_b  # (19)
        piston += stop_force(cylinder, actuator.length, actuator.lever * state.v[i])
        force[i] = actuator.lever * piston  # (18)


@njit(cache=True, error_model="numpy")
def _move(
    constants: Constants, hidden: Hidden | None, state: State, scratch: Scratch, step: float
) -> None:
    """Velocities from the forces (6), then positions and cylinders from the new velocities."""
    mass_and_bias(constants.chain, state.q, state.v, scratch.mass, scratch.bias)
    _generalized_forces(constants, state, scratch.force)
    law = constants.friction
    for i in range(4):
        scratch.before[i] = state.v[i]
    if hidden is not None:
        act(hidden, constants, state, scratch, step)
        law = scratch.law
    for i in range(4):
        impulse = step * (scratch.force[i] - scratch.bias[i])
        for j in range(4):
            impulse += scratch.mass[i, j] * state.v[j]
        scratch.impulse[i] = impulse
    if constants.dynamic_friction:
        step_lugre(
            law, scratch.mass, scratch.impulse, step,
            state.bristle, scratch.friction, state.v,
        )  # fmt: skip
    else:
        step_set_valued(
            law, scratch.mass, scratch.impulse, step,
            state.mode, scratch.friction, state.v,
        )  # fmt: skip
    if hidden is not None:
        settle(hidden, constants, state, scratch, step)
    for i in range(4):
        state.q[i] += step * state.v[i]
        scratch.growth[i] = -state.actuators[i].length
    set_lengths_and_levers(constants.linkages, state.q, state.actuators)
    for i in range(4):  # by what the length really changed, so that no oil is made or lost
        scratch.growth[i] = (scratch.growth[i] + state.actuators[i].length) / step


@njit(cache=True, error_model="numpy")
def _fill(
    constants: Constants, hidden: Hidden | None, state: State, growth: np.ndarray, step: float
) -> None:
    """Chamber and supply pressures from valve openings and piston speeds `growth` (4,)."""
    oil, supply = constants.oil, state.supply[0]
    drawn = 0.0
    for i in range(4):
        cylinder, valve = constants.cylinders[i], constants.valves[i]
        actuator = state.actuators[i]
        p_a, p_b = actuator.p_a, actuator.p_b
        x = opening(actuator.spool - valve.null, valve.dead_zone)
        leakage, softer_a, softer_b = cylinder.leakage, 1.0, 1.0
        if hidden is not None:
            x = meter(hidden, constants, state, i)
            leakage = leak(hidden, constants, state, i)
            softer_a = softness(hidden, constants, i, p_a)
            softer_b = softness(hidden, constants, i, p_b)
        volume = cylinder.dead_volume_a + cylinder.area_a * (actuator.length - cylinder.length_min)
        flow, slope = port_flow(oil, valve.flow_gain * x, supply, p_a)
        actuator.p_a, flow_a = chamber_step(
            oil, p_a, p_b, flow, slope, leakage, softer_a * volume,
            cylinder.area_a * growth[i], step,
        )  # fmt: skip
        if hidden is not None:
            note_softness(hidden, constants, i, p_a, volume, (actuator.p_a - p_a) / step)
        volume = cylinder.dead_volume_b + cylinder.area_b * (cylinder.length_max - actuator.length)
        flow, slope = port_flow(oil, -valve.flow_gain * x, supply, p_b)
        actuator.p_b, flow_b = chamber_step(
            oil, p_b, p_a, flow, slope, leakage, softer_b * volume,
            -cylinder.area_b * growth[i], step,
        )  # fmt: skip
        if x > 0.0:
            drawn += flow_a
        elif x < 0.0:
            drawn += flow_b
    supplied = pump_flow(oil, supply) - relief_flow(oil, supply)
    state.supply[0] += step * oil.bulk_modulus / oil.supply_volume * (supplied - drawn)


@njit(cache=True, error_model="numpy")
def _advance(
    constants: Constants,
    hidden: Hidden | None,
    state: State,
    scratch: Scratch,
    command: np.ndarray,
    step: float,
    count: int,
) -> None:
    for _ in range(count):
        for i in range(4):
            actuator = state.actuators[i]
            actuator.spool, actuator.spool_rate = spool_step(
                constants.valves[i], command[i], actuator.spool, actuator.spool_rate, step
            )
        _move(constants, hidden, state, scratch, step)
        _fill(constants, hidden, state, scratch.growth, step)


class Plant:
    """The stand-in machine in motion.

    It starts at rest at `q0` (4,) with centred spools and chamber pressures that carry gravity; the
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
    ):
        """`RangeError` if q0 is outside Table 2 or gravity exceeds what the pump can hold."""
        _check_pose(machine, q0)
        self.parameters, self.machine = parameters, machine
        self.time = 0.0  # s
        self.tank_pressure = machine.hydraulics.tank_pressure
        self._constants = pack(parameters, machine)
        self._hidden = work(planted, machine)  # None is compiled apart: no cost where none hides
        self._scratch = Scratch(
            mass=np.empty((4, 4)),
            bias=np.empty(4),
            force=np.zeros(4),
            impulse=np.empty(4),
            friction=np.empty((5, 4)),
            growth=np.empty(4),
            before=np.zeros(4),
            law=self._constants.friction.copy(),
        )
        self._step = parameters.step
        self._state = self._at_rest(np.array(q0, dtype=float))

    def advance(self, command: np.ndarray, duration: float) -> None:
        """Run for `duration` [s] with spool commands (4,) in -1..1; positive moves a joint up.

        Steps are equal and at most `parameters.step`. `RangeError` if a command is not finite, or
        the crane was driven out of the range in which its linkages can be assembled.
        """
        command = np.ascontiguousarray(command, dtype=float)
        if not np.isfinite(command).all():
            raise RangeError(f"valve command {command}: must be finite, in -1..1 for each joint")
        count = max(1, math.ceil(duration / self.parameters.step - 1e-6))
        self._step = duration / count
        _advance(
            self._constants, self._hidden, self._state, self._scratch, command, self._step, count
        )
        self.time += duration
        if not np.isfinite(self._state.q).all():
            raise RangeError(
                f"plant: a linkage was forced open before t = {self.time:.4f} s; stiffen the end "
                "stops (cylinders.*.stop_stiffness) or shorten the step"
            )

    @property
    def q(self) -> np.ndarray:
        """(4,) coordinates [rad, m]; this and the others in the order of JOINTS."""
        return self._state.q.copy()

    @property
    def v(self) -> np.ndarray:
        """(4,) velocities [rad/s, m/s]; exactly 0 where a joint sticks by (13)."""
        return self._state.v.copy()

    @property
    def acceleration(self) -> np.ndarray:
        """(4,) mean over the last step [rad/s2, m/s2]; 0 before the first."""
        return (self._state.v - self._scratch.before) / self._step

    @property
    def hidden_count(self) -> int:
        """How many hidden effects act in the plant."""
        return 0 if self._hidden is None else len(self._hidden.law)

    @property
    def hidden_flow(self) -> np.ndarray:
        """(k, 4) what flows more into chamber A for each hidden effect [m3/s]."""
        return np.zeros((0, 4)) if self._hidden is None else self._hidden.flow.copy()

    @property
    def hidden_force(self) -> np.ndarray:
        """(k, 4) what each hidden effect asked of the drives in the last step [N m, N]."""
        return np.zeros((0, 4)) if self._hidden is None else self._hidden.force.copy()

    @property
    def pressure_a(self) -> np.ndarray:
        """(4,) pressures of chambers A [Pa]."""
        return self._state.actuators["p_a"].copy()

    @property
    def pressure_b(self) -> np.ndarray:
        """(4,) pressures of chambers B [Pa]."""
        return self._state.actuators["p_b"].copy()

    @property
    def spool(self) -> np.ndarray:
        """(4,) spool positions in -1..1; positive extends the cylinder."""
        return self._state.actuators["spool"].copy()

    @property
    def supply_pressure(self) -> float:
        """Pressure of the supply line [Pa]."""
        return float(self._state.supply[0])

    def _at_rest(self, q: np.ndarray) -> State:
        constants, scratch = self._constants, self._scratch
        actuators = np.zeros(len(JOINTS), np.dtype([(name, float) for name in ACTUATOR]))
        set_lengths_and_levers(constants.linkages, q, actuators)
        state = State(
            q=q,
            v=np.zeros(4),
            mode=np.zeros(4, dtype=np.int64),
            bristle=np.zeros(4),
            actuators=actuators,
            supply=np.array([self.machine.hydraulics.supply_pressure]),
        )
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
                f"{JOINTS[i]}: at the pose {np.round(q, 4).tolist()} gravity needs a cylinder "
                f"force of {piston[i]:.0f} N, more than the supply pressure of {supply:.4g} Pa can "
                "hold; start from another pose"
            )
        actuators["p_a"], actuators["p_b"] = p_a, p_b
        return state


def _check_pose(machine: Machine, q0: np.ndarray) -> None:
    for i, joint in enumerate(JOINTS):
        limits = machine.limits[joint]
        if not limits.position_min <= q0[i] <= limits.position_max:
            raise RangeError(
                f"{joint}: the plant cannot start at {q0[i]:.6g} {JOINT_UNITS[joint]}, outside "
                f"[{limits.position_min}, {limits.position_max}] of Table 2"
            )
