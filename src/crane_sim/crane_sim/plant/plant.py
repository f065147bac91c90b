"""The plant: valves, oil, cylinders, bodies and friction, stepped together."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numba import njit

from crane_model.errors import RangeError
from crane_model.hydraulics.stepping import transition
from crane_model.machine import Machine
from crane_sim.effects.flow import leak, meter, note_softness, softness
from crane_sim.effects.form import Injected, InjectedForm, packed
from crane_sim.effects.kernel import act, settle
from crane_sim.parts.borrowed import borrowed
from crane_sim.parts.constants import Constants, Scratch, State, at_rest, pack, room
from crane_sim.parts.cylinders import (
    chamber_step,
    compensated_flow,
    conductances,
    opening,
    port_flow,
    pump_flow,
    relief_flow,
    set_lengths_and_levers,
    spool_step,
    step_lugre,
    step_set_valued,
    stop_force,
)
from crane_sim.parts.parameters import SimulatedCrane, column
from crane_sim.parts.rigid_bodies import mass_and_bias


@njit(cache=True, error_model="numpy", forceinline=True)
def _generalized_forces(constants: Constants, state: State, force: np.ndarray) -> None:
    """Driving forces of the joints without friction and inertia: (j,) N m, N.

    `injected.kernel` has what injected effects add to it, to the bodies and to the friction.
    """
    for i in range(len(state.q)):
        cylinder, actuator = constants.cylinders[i], state.actuators[i]
        piston = cylinder.area_a * actuator.p_a - cylinder.area_b * actuator.p_b  # (19)
        piston += stop_force(cylinder, actuator.length, actuator.lever * state.v[i])
        force[i] = actuator.lever * piston  # (18)


@njit(cache=True, error_model="numpy", forceinline=True)
def _move(
    constants: Constants, injected: Injected | None, state: State, scratch: Scratch, step: float
) -> None:
    """Velocities from the forces (6), then positions and cylinders from the new velocities."""
    mass_and_bias(constants.chain, state.q, state.v, scratch.mass, scratch.bias)
    _generalized_forces(constants, state, scratch.force)
    law = constants.friction
    for i in range(len(state.q)):
        scratch.before[i] = state.v[i]
    if injected is not None:
        act(injected, constants, state, scratch, step)
        law = scratch.law
    for i in range(len(state.q)):
        impulse = step * (scratch.force[i] - scratch.bias[i])
        for j in range(len(state.q)):
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
    if injected is not None:
        settle(injected, constants, state, scratch, step)
    for i in range(len(state.q)):
        state.q[i] += step * state.v[i]
        scratch.growth[i] = -state.actuators[i].length
    set_lengths_and_levers(constants.linkages, state.q, state.actuators)
    # by what the length really changed, so that no oil is made or lost
    for i in range(len(state.q)):
        scratch.growth[i] = (scratch.growth[i] + state.actuators[i].length) / step


@njit(cache=True, error_model="numpy", forceinline=True)
def load_pressure(constants: Constants, state: State) -> float:
    """The highest pressure of the chambers that valves feed [Pa]; the tank's if none is open."""
    highest = constants.oil.tank_pressure
    for i in range(len(state.q)):
        actuator, valve = state.actuators[i], constants.valves[i]
        x = opening(actuator.spool - valve.null, valve.dead_band)
        if x > 0.0:
            highest = max(highest, actuator.p_a)
        elif x < 0.0:
            highest = max(highest, actuator.p_b)
    return highest


@njit(cache=True, error_model="numpy", forceinline=True)
def _fill(
    constants: Constants, injected: Injected | None, state: State, growth: np.ndarray, step: float
) -> None:
    """Chamber and supply pressures from valve openings and piston speeds `growth` (j,)."""
    oil, supply = constants.oil, state.supply[0]
    drawn, load = 0.0, oil.tank_pressure
    if oil.load_sensing:
        load = load_pressure(constants, state)
    for i in range(len(state.q)):
        cylinder, valve = constants.cylinders[i], constants.valves[i]
        actuator = state.actuators[i]
        p_a, p_b = actuator.p_a, actuator.p_b
        x = opening(actuator.spool - valve.null, valve.dead_band)
        leakage, softer_a, softer_b = cylinder.leakage, 1.0, 1.0
        if injected is not None:  # a call that finds nothing to do costs more than the rest
            if injected.meters:
                x = meter(injected, constants, state, i)
            if injected.leaks:
                leakage = leak(injected, constants, state, i)
            if injected.softens:
                softer_a = softness(injected, constants, i, p_a)
                softer_b = softness(injected, constants, i, p_b)
        open_a, open_b = conductances(valve, x)
        volume = cylinder.dead_volume_a + cylinder.filled_a * (
            actuator.length - cylinder.length_min
        )
        if oil.load_sensing and open_a > 0.0:
            flow, slope = compensated_flow(oil, open_a, supply, load, p_a)
        else:
            flow, slope = port_flow(oil, open_a, supply, p_a)
        actuator.p_a, flow_a = chamber_step(
            oil, p_a, p_b, flow, slope, leakage, softer_a * volume,
            cylinder.area_a * growth[i], step,
        )  # fmt: skip
        if injected is not None and injected.softens:
            note_softness(injected, constants, i, p_a, volume, (actuator.p_a - p_a) / step)
        volume = cylinder.dead_volume_b + cylinder.filled_b * (
            cylinder.length_max - actuator.length
        )
        if oil.load_sensing and open_b > 0.0:
            flow, slope = compensated_flow(oil, open_b, supply, load, p_b)
        else:
            flow, slope = port_flow(oil, open_b, supply, p_b)
        actuator.p_b, flow_b = chamber_step(
            oil, p_b, p_a, flow, slope, leakage, softer_b * volume,
            -cylinder.area_b * growth[i], step,
        )  # fmt: skip
        if x > 0.0:
            drawn += flow_a
        elif x < 0.0:
            drawn += flow_b
    supplied = pump_flow(oil, supply, load) - relief_flow(oil, supply, load)
    state.supply[0] += step * oil.bulk_modulus / oil.supply_volume * (supplied - drawn)


@njit(cache=True, error_model="numpy")
def advance(
    constants: Constants,
    injected: Injected | None,
    state: State,
    scratch: Scratch,
    command: np.ndarray,
    step: float,
    count: int,
) -> None:
    """`count` steps of `step` [s] with valve commands (j,) in -1..1.

    Oil flows through the opening that a spool has in the middle of a step, in the mean.
    """
    constants, injected = borrowed(constants), borrowed(injected)
    state, scratch = borrowed(state), borrowed(scratch)
    half = 0.5 * step
    free = [transition(valve.frequency, valve.damping_ratio, half) for valve in constants.valves]
    for _ in range(count):
        _shift(constants, state, free, command, half)
        _move(constants, injected, state, scratch, step)
        _fill(constants, injected, state, scratch.growth, step)
        _shift(constants, state, free, command, half)


@njit(cache=True, error_model="numpy", forceinline=True)
def _shift(
    constants: Constants,
    state: State,
    free: list[tuple[float, float, float, float]],
    command: np.ndarray,
    step: float,
) -> None:
    """Spools, of which `free` is the transition in that time."""
    for i in range(len(state.q)):
        actuator = state.actuators[i]
        actuator.spool, actuator.spool_rate = spool_step(
            constants.valves[i], free[i], command[i], actuator.spool, actuator.spool_rate, step
        )


SHORTEST_SPAN_S = 1e-6  # below which nothing is simulated


class DeadTime:
    """The dead time of j pilot-operated valves: each command acts `now` seconds later.

    Before the first one, the valves hear 0.
    """

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
        """Durations and commands (j,) that spools hear from `begin` [s] on, given `command`."""
        if self._none:
            yield duration, command
            return
        self._given.append((begin, command.copy()))
        dead, end = self.now(begin), begin + duration
        while len(self._given) > 1 and self._given[1][0] + dead.max() <= begin:
            self._given.pop(0)
        changes = [given + late for given, _ in self._given for late in dead]
        inside = sorted(
            {at for at in changes if begin + SHORTEST_SPAN_S < at < end - SHORTEST_SPAN_S}
        )
        for first, last in zip([begin, *inside], [*inside, end], strict=True):
            if last - first > SHORTEST_SPAN_S:
                yield last - first, self._at(first + SHORTEST_SPAN_S - dead)

    def _at(self, given: np.ndarray) -> np.ndarray:
        """(j,) what was in force, of each joint at its own time (j,) [s]."""
        in_force = self._given[0][1].copy()
        for time, command in self._given:
            later = given >= time
            in_force[later] = command[later]
        return in_force


class Plant:
    """The simulated crane in motion.

    It starts at rest with centred spools and chamber pressures that carry gravity; the two
    pressures of a cylinder then add up to the supply pressure where that is possible, as a valve
    with equal metering edges leaves them; with load sensing, to that of an idle pump. Nothing in it
    is random: noise is in the sensors.

    Parameters
    ----------
    parameters, machine
        Parameters and geometry.
    q0
        (j,) pose at the start [rad, m].
    effects
        Injected effects; faults of sensors among them have no part in it.
    running
        For how long the machine has been on [s]: what warms up or wears goes on from there.

    Raises
    ------
    RangeError
        If q0 is outside Table 2, or gravity exceeds what the pump can hold.
    """

    def __init__(
        self,
        parameters: SimulatedCrane,
        machine: Machine,
        q0: np.ndarray,
        effects: Sequence[InjectedForm] = (),
        running: float = 0.0,
    ):
        _check_pose(machine, q0)
        self.parameters, self.machine = parameters, machine
        self.time = running  # s since the machine was started
        self.tank_pressure = machine.hydraulics.tank_pressure
        self._constants = pack(parameters, machine)
        self._leakage = self._constants.cylinders["leakage"].copy()
        # None is compiled apart: no cost without effects
        self._injected = packed(effects, machine, running)
        self._scratch = room(self._constants.friction)
        self._step = parameters.step
        self._dead_time = DeadTime(parameters)
        self._state = self._at_rest(np.array(q0, dtype=float))

    def advance(self, command: np.ndarray, duration: float) -> None:
        """Run for `duration` [s] with valve commands (j,) in -1..1; positive moves a joint up.

        Steps are equal and at most `parameters.step`. `RangeError` if a command is not finite, or
        the crane was driven out of the range in which its linkages can be assembled.
        """
        command = np.ascontiguousarray(command, dtype=float)
        if not all(map(math.isfinite, command.tolist())):  # np.isfinite costs more for a few joints
            raise RangeError(f"valve command {command}: must be finite, in -1..1 for each joint")
        end = self.time + duration
        for length, heard in self._dead_time.heard(command, self.time, duration):
            count = max(1, math.ceil(length / self.parameters.step - 1e-6))
            self._step = length / count
            advance(
                *(self._constants, self._injected, self._state, self._scratch),
                *(heard, self._step, count),
            )
        self.time = end
        if not all(map(math.isfinite, self._state.q.tolist())):
            raise RangeError(
                f"plant: a linkage was forced open before t = {self.time:.4f} s; stiffen the end "
                "stops (cylinders.*.stop_stiffness) or shorten the step"
            )

    def leak(self, passed: np.ndarray) -> None:
        """From now on pistons let `passed` (j,) more oil through, m3/(s Pa)."""
        self._constants.cylinders["leakage"] = self._leakage + passed

    def set_magnitude(self, k: int, magnitude: float, *shape: float) -> None:
        """Set magnitude, and `shape` if given, of the k-th injected effect in the plant."""
        count = len(self.injected_force)
        if not 0 <= k < count or self._injected is None:
            raise RangeError(f"plant: no injected effect {k}; it has {count}")
        self._injected.value[k, : 1 + len(shape)] = magnitude, *shape

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
    def injected_flow(self) -> np.ndarray:
        """(k, j) what flows more into chamber A for each injected effect [m3/s]."""
        return (
            np.zeros((0, len(self._state.q)))
            if self._injected is None
            else self._injected.flow.copy()
        )

    @property
    def injected_force(self) -> np.ndarray:
        """(k, j) what each injected effect asked of the drives in the last step [N m, N]."""
        return (
            np.zeros((0, len(self._state.q)))
            if self._injected is None
            else self._injected.force.copy()
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
        if self._injected is not None:
            act(self._injected, constants, state, scratch, self._step)
        tank, supply = self.tank_pressure, self.machine.hydraulics.supply_pressure
        area_a, area_b = constants.cylinders["area_a"], constants.cylinders["area_b"]
        piston = (scratch.bias - scratch.force) / actuators["lever"]
        sensing = self.machine.hydraulics.load_sensing
        left = supply if sensing is None else sensing.margin + tank
        p_a = (piston + area_b * (left + tank)) / (area_a + area_b)
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
                f"its limits [{limits.position_min}, {limits.position_max}]"
            )
