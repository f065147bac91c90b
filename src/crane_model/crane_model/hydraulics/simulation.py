"""The identified crane from its valves: mechanics (16) and oil together, many runs side by side.

The terms of the model give the mechanics at every instant of a stretch of motion, all at once.
Between these instants, valves, chambers, supply and dry friction are stepped in compiled code. The
terms are then evaluated again, along the motion that this gave, until it stays. The piston follows
the flow, so that two or three passes do.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError, RangeError
from crane_model.hydraulics import ChamberValues, HydraulicValues, ValveValues
from crane_model.hydraulics.stepping import (
    Circuit,
    CraneCourse,
    Mechanics,
    advance,
    move_spools,
    openings,
    spool_course,
    trailing,
)
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term

MAX_SUBSTEP_S = 2.5e-4  # a fiftieth of the fastest oscillation of oil and booms
STRETCH_INSTANTS = 50  # instants whose mechanics is asked for at once
MAX_PASSES = 8
SETTLED_CHANGE = 1e-7  # rad or m: what the last pass may still change of a position
STOP_FORCE = 1e9  # N m, N: what a stop can hold
VELOCITY_NUDGE = 1e-4  # of velocity, rad/s or m/s, for the slope of the forces


@dataclass(frozen=True)
class CraneState:
    """N runs of j joints, of the model and in its order."""

    position: Array  # (N, j) rad or m
    velocity: Array  # (N, j)
    pressure_a: Array  # (N, j) Pa
    pressure_b: Array  # (N, j) Pa


def substeps(period: float) -> int:
    """How many openings `simulate_openings` wants from an instant to the next."""
    return int(np.ceil(period / MAX_SUBSTEP_S - 1e-9))


def valve_openings(
    valve: ValveValues, sense: float, stamps: Array, commands: Array, times: Array
) -> Array:
    """Openings (n,) at increasing `times` (n,) [s] from commands (m,) held from their `stamps`.

    `sense` is +1 where extending the cylinder moves the joint in its positive direction, else -1.
    """
    y = spool_course(
        stamps + valve.delay,
        sense * commands,
        times,
        valve.spool_frequency,
        valve.damping_ratio.value,
    )
    edges = trailing(y, valve.hysteresis.value)
    return openings(edges, valve.dead_band_a.value, valve.dead_band_b.value)


def simulate_openings(
    model: Model,
    start: CraneState,
    opened: Array,
    period: float,
    beside: Mapping[str, Array] | None = None,
) -> tuple[Array, Array]:
    """Positions and velocities (T, N, j) at instants `period` [s] apart, from a state of N runs.

    `opened` (T - 1, S, N, j): the openings of the valves from each instant to the next, in the
    middle of S equal steps (see `substeps`, `valve_openings`). `beside` holds what terms of the
    model ask of a record besides motion, force and pressures, by its field there, (T, N, ...) each.

    `ConfigurationError` if the model has no values, or no hydraulics of a joint; `RangeError` if
    the motion leaves the range in which a linkage can be assembled.
    """
    asking = ModelMechanics(model, beside or {}, period, simulated_circuit(model))
    runs, joints = start.position.shape
    states = asking.memory(start)
    stretch = 1 if states else STRETCH_INSTANTS  # a memory is advanced from instant to instant
    shape = (len(opened) + 1, runs, joints)
    whole = CraneCourse(
        np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape[:2])
    )
    whole.position[0], whole.velocity[0] = start.position, start.velocity
    whole.chamber_a[0], whole.chamber_b[0] = start.pressure_a, start.pressure_b
    whole.supply[0] = asking.circuit.supply_pressure
    for k in range(0, len(opened), stretch):
        between = np.ascontiguousarray(opened[k : k + stretch])
        course = CraneCourse(*(values[k : k + len(between) + 1] for values in whole))
        settle(asking, k, course, between, states)
        states = asking.advanced(states, k, course)
    return whole.position, whole.velocity


def settle(
    asking: "ModelMechanics",
    k: int,
    course: CraneCourse,
    between: Array,
    memory: Mapping[Term, Array],
) -> None:
    """Write the course behind its first instant, instant k; `RangeError` if it diverges."""
    step = asking.period / between.shape[1]
    for values in course:
        values[1:] = values[:1]
    asked = course.position.copy()
    for number in range(MAX_PASSES):
        mechanics = asking.mechanics(k, course, memory)
        advance(asking.circuit, mechanics, between, step, course)
        change = float(np.abs(course.position - asked).max())
        if not np.isfinite(change):
            raise RangeError(
                f"simulation of '{asking.model.name}': the motion grows beyond all bounds; its "
                "values are not physical"
            )
        if change < SETTLED_CHANGE or (len(between) == 1 and number):
            return
        asked = course.position.copy()


def simulated_circuit(model: Model) -> Circuit:
    """As `circuit_of`, to simulate; `ConfigurationError` for load sensing, too."""
    machine, _ = identified(model)
    if machine.hydraulics.load_sensing is not None:
        raise ConfigurationError(
            f"model '{model.name}': {machine.name} has load sensing, but a simulation needs a "
            "supply whose pressure no load changes; use recordings, or the simulated crane"
        )
    return circuit_of(model)


def circuit_of(model: Model) -> Circuit:
    """Constants of the circuit; `ConfigurationError` if one is missing."""
    machine, known = identified(model)
    valves, oil = zip(*(_parts(model, known, joint) for joint in model.joints), strict=True)
    cylinders = [machine.cylinders[joint] for joint in model.joints]
    volumes = [cylinder.chambers for cylinder in cylinders]
    pressure, droop = machine.hydraulics.supply_pressure, 0.0
    if known.supply is not None:
        pressure, droop = known.supply.pressure.value, known.supply.droop.value
    return Circuit(
        **_measured(valves, ("supply_a", "a_tank", "supply_b", "b_tank")),
        **_measured(oil, tuple(ChamberValues.units)),
        area_a=np.array([cylinder.area_a for cylinder in cylinders]),
        area_b=np.array([cylinder.area_b for cylinder in cylinders]),
        growth_a=np.array([volume.growth_a for volume in volumes]),
        growth_b=np.array([volume.growth_b for volume in volumes]),
        empty_a=np.array([volume.empty_a for volume in volumes]),
        empty_b=np.array([volume.empty_b for volume in volumes]),
        supply_pressure=pressure,
        droop=droop,
        tank_pressure=machine.hydraulics.tank_pressure,
    )


def _measured(
    joints: Sequence[ValveValues | ChamberValues], names: Sequence[str]
) -> dict[str, Array]:
    """Arrays (j,) of the values of these names, by name."""
    return {name: np.array([getattr(joint, name).value for joint in joints]) for name in names}


def identified(model: Model) -> tuple[Machine, HydraulicValues]:
    """The machine and its hydraulics; `ConfigurationError` if they were not identified."""
    if model.hydraulics is None or model.machine is None:
        raise ConfigurationError(
            f"model '{model.name}' holds no hydraulics; identify them from recordings with valve "
            "commands and pressures"
        )
    return model.machine, model.hydraulics


def _parts(model: Model, known: HydraulicValues, joint: str) -> tuple[ValveValues, ChamberValues]:
    values = known.joints.get(joint)
    if values is None or values.chambers is None:
        why = known.unknown.get(joint, "recordings with its chamber pressures would determine it")
        raise ConfigurationError(
            f"model '{model.name}': the hydraulics of {joint} are not identified: {why}"
        )
    return values.valve, values.chambers


@dataclass(frozen=True)
class ModelMechanics:
    """Mechanics of the model's terms at an instant."""

    model: Model
    beside: Mapping[str, Array]
    period: float
    circuit: Circuit
    held: Array | None = None  # (N, j): joints that a stop holds

    def memory(self, start: CraneState) -> dict[Term, Array]:
        runs = len(start.position)
        still = CraneCourse(
            start.position[np.newaxis],
            start.velocity[np.newaxis],
            start.pressure_a[np.newaxis],
            start.pressure_b[np.newaxis],
            np.full((1, runs), self.circuit.supply_pressure),
        )
        record = self._record(0, still, self.cylinder(still.position))
        begun = {term: term.start(record, self.model.setting) for term in self.model.terms}
        return {term: state for term, state in begun.items() if state.shape[1]}

    def advanced(
        self, states: Mapping[Term, Array], k: int, course: CraneCourse
    ) -> dict[Term, Array]:
        """States at the end of a course of two instants, the first of which is instant k."""
        if not states:
            return {}
        ends = [CraneCourse(*(values[i : i + 1] for values in course)) for i in (0, 1)]
        before, after = (
            self._record(k + i, end, self.cylinder(end.position)) for i, end in enumerate(ends)
        )
        setting = self.model.setting
        return {term: term.advance(state, before, after, setting) for term, state in states.items()}

    def mechanics(self, k: int, course: CraneCourse, memory: Mapping[Term, Array]) -> Mechanics:
        """About every state of a course but the last, from one evaluation of the model.

        It is evaluated on 2 j + 2 stacked cases of acceleration, direction of motion and velocity.
        """
        asked = CraneCourse(*(values[:-1] for values in course))
        instants, runs, joints = asked.position.shape
        cylinder = self.cylinder(asked.position)
        cases = 2 * joints + 2
        velocity = np.tile(asked.velocity.reshape(-1, joints), (cases, 1, 1))
        acceleration, direction = np.zeros((2, *velocity.shape))
        for j in range(joints):
            acceleration[j, :, j] = 1.0
            velocity[joints + 2 + j, :, j] += VELOCITY_NUDGE
        direction[joints + 1] = 1.0
        record = self._record(k, asked, cylinder)
        rows = np.tile(np.arange(instants * runs), cases)
        record = replace(
            record.take(rows),
            velocity=velocity.reshape(-1, joints),
            acceleration=acceleration.reshape(-1, joints),
            direction_known=direction.reshape(-1, joints),
            memory={term: np.tile(state, (cases, 1)) for term, state in memory.items()},
        )
        force = self.model.predict(record).reshape(cases, -1, joints)
        rest = force[joints]
        mass = (force[:joints] - rest).transpose(1, 2, 0)
        damping = (force[joints + 2 :] - rest).transpose(1, 2, 0) / VELOCITY_NUDGE
        shape = (instants, runs, joints)
        dry = np.maximum(force[joints + 1] - rest, 0.0).reshape(shape)
        if self.held is not None:
            dry[:, self.held] = STOP_FORCE
        return Mechanics(
            position=asked.position.copy(),
            velocity=asked.velocity.copy(),
            inverse=self._inverse(mass).reshape(*shape, joints),
            load=-rest.reshape(shape),
            damping=np.ascontiguousarray(damping).reshape(*shape, joints),
            dry=dry,
            cylinder=cylinder,
        )

    def _inverse(self, mass: Array) -> Array:
        """Inverses of mass matrices (n, j, j); `RangeError` if one is not positive definite."""
        if np.isfinite(mass).all() and (np.linalg.eigvalsh(mass) > 0.0).all():
            return np.linalg.inv(mass).astype(float)
        raise RangeError(
            f"simulation of '{self.model.name}': the mass matrix is not positive definite; the "
            "inertial values of the model are not physical, or the motion has grown beyond all "
            "bounds"
        )

    def cylinder(self, q: Array) -> Array:
        """(..., j, 3) length, lever arm and its derivative; `RangeError` outside the linkages."""
        machine, joints = self.model.machine, self.model.joints
        assert machine is not None  # checked by `simulated_circuit`
        flat = q.reshape(-1, len(joints))
        parts = [machine.cylinder(joint, flat[:, j]) for j, joint in enumerate(joints)]
        cylinder = np.stack(parts, axis=1)
        if not np.isfinite(cylinder).all():
            joint = joints[int(np.argwhere(~np.isfinite(cylinder))[0, 1])]
            raise RangeError(
                f"simulation of '{self.model.name}': {joint} left the range in which its linkage "
                "can be assembled"
            )
        return cylinder.reshape(*q.shape, 3)

    def _record(self, k: int, course: CraneCourse, cylinder: Array) -> Record:
        """All runs at the instants of a course, the first of which is instant k."""
        circuit = self.circuit
        instants, runs, joints = course.position.shape
        piston = circuit.area_a * course.chamber_a - circuit.area_b * course.chamber_b
        given = {
            name: values[k : k + instants].reshape(instants * runs, *values.shape[2:])
            for name, values in self.beside.items()
        }
        flat = (-1, joints)
        signals = {
            "time": np.repeat(self.period * (k + np.arange(instants)), runs),
            "force": (cylinder[..., 1] * piston).reshape(flat),
            "pressure_a": course.chamber_a.reshape(flat),
            "pressure_b": course.chamber_b.reshape(flat),
            "supply_pressure": course.supply.ravel(),
            "tank_pressure": np.full(instants * runs, circuit.tank_pressure),
        } | given
        return Record(
            joints=self.model.joints,
            position=course.position.reshape(flat),
            velocity=course.velocity.reshape(flat),
            acceleration=np.zeros((instants * runs, joints)),
            memory=None,
            force_at=None,
            **signals,
        )


MAX_CYCLE_S = 0.005  # for which the mechanics of a state holds
REMEMBERED_S = 1.0  # of commands: none may be later


class CranePressures(NamedTuple):
    """Pressures of N runs of j joints [Pa]."""

    chamber_a: Array  # (N, j)
    chamber_b: Array  # (N, j)
    supply: Array  # (N,)


class IdentifiedSimulation:
    """N cranes of the joints of a model, at rest at first."""

    def __init__(self, model: Model, position: Array, late: Array | None = None):
        """At `position` (N, j); `late` (N,) [s] is what passes from a command to the spool (0).

        `ConfigurationError` if the model lacks values or the hydraulics of a joint; `RangeError`
        where the supply pressure cannot hold the joints.
        """
        machine, known = identified(model)
        self.joints, self.time = model.joints, 0.0
        self._late = np.zeros(len(position)) if late is None else np.asarray(late, dtype=float)
        self._circuit = simulated_circuit(model)
        self._mechanics = ModelMechanics(model, {}, MAX_CYCLE_S, self._circuit)
        valves = [known.joints[joint].valve for joint in model.joints]
        names = "natural_frequency", "damping_ratio", "hysteresis", "dead_band_a", "dead_band_b"
        values = [[getattr(valve, name).value for valve in valves] for name in names]
        self._frequency, self._damping, self._play, *self._dead_bands = np.array(values)
        self._low, self._high, *_ = machine.ranges(model.joints)
        self._state = self._at_rest(np.array(position, dtype=float))
        self._sense = np.sign(self._mechanics.cylinder(self.position)[..., 1])
        self._memory = self._mechanics.memory(_begin(self._state))
        self._spools = np.zeros((3, *position.shape))
        self._commands = deque([(-np.inf, np.zeros(position.shape))])

    @property
    def position(self) -> Array:
        """(N, j) rad, m."""
        now: Array = self._state.position[0]
        return now.copy()

    @property
    def velocity(self) -> Array:
        """(N, j) rad/s, m/s."""
        now: Array = self._state.velocity[0]
        return now.copy()

    @property
    def pressures(self) -> CranePressures:
        state = self._state
        return CranePressures(
            state.chamber_a[0].copy(), state.chamber_b[0].copy(), state.supply[0].copy()
        )

    def advance(self, commands: Array, duration: float) -> None:
        """Run on for `duration` [s] with commands (N, j) in -1..1; positive moves a joint up.

        `RangeError` if a command is not finite or the motion grows beyond all bounds.
        """
        if not np.isfinite(commands).all():
            raise RangeError(f"valve command {commands}: must be finite, in -1..1 for each joint")
        self._commands.append((self.time, np.clip(commands, -1.0, 1.0)))
        count = max(1, int(np.ceil(duration / MAX_CYCLE_S - 1e-6)))
        for _ in range(count):
            self._step(duration / count)
        while len(self._commands) > 1 and self._commands[1][0] < self.time - REMEMBERED_S:
            self._commands.popleft()

    def _step(self, period: float) -> None:
        steps = substeps(period)
        asked = self._sense * self._due(self.time + period * (np.arange(steps) + 0.5) / steps)
        edges = move_spools(
            self._spools, asked, period / steps, self._frequency, self._damping, self._play
        )
        between = np.empty((1, *edges.shape))
        for j, (a, b) in enumerate(zip(*self._dead_bands, strict=True)):
            between[0, ..., j] = openings(edges[..., j].ravel(), a, b).reshape(edges.shape[:2])
        course = CraneCourse(*(np.concatenate((values, values)) for values in self._state))
        mechanics = replace(
            self._mechanics, period=period, held=self._stopped(between.mean(axis=(0, 1)))
        )
        settle(mechanics, 0, course, between, self._memory)
        self._memory = mechanics.advanced(self._memory, 0, course)
        self._state = CraneCourse(*(values[1:] for values in course))
        held = np.clip(self._state.position, self._low, self._high)
        self._state.velocity[held != self._state.position] = 0.0
        self._state.position[:] = held
        self.time += period

    def _stopped(self, opening: Array) -> Array:
        """(N, j) whether a joint stands at a limit, and its valve does not lead it away."""
        motion = self._sense * opening
        position = self._state.position[0]
        stopped: Array = ((position >= self._high) & (motion >= 0.0)) | (
            (position <= self._low) & (motion <= 0.0)
        )
        return stopped

    def _due(self, times: Array) -> Array:
        """Commands (S, N, j) that have reached the spools at `times` (S,)."""
        stamps = np.array([stamp for stamp, _ in self._commands])
        commands = np.array([command for _, command in self._commands])
        newest = np.searchsorted(stamps, times[:, np.newaxis] - self._late, side="right") - 1
        due: Array = commands[np.maximum(newest, 0), np.arange(len(self._late))]
        return due

    def _at_rest(self, position: Array) -> CraneCourse:
        """Chamber pressures that carry the weight, and add up to that of the supply."""
        circuit, joints = self._circuit, self.joints
        outside = (position < self._low) | (position > self._high)
        if outside.any():
            n, j = np.argwhere(outside)[0]
            raise RangeError(
                f"{joints[j]}: the crane cannot start at {position[n, j]:.6g}, outside "
                f"[{self._low[j]:g}, {self._high[j]:g}] of its machine"
            )
        full = np.full(position.shape, circuit.supply_pressure)
        parts = (position, np.zeros(position.shape), 0.5 * full, 0.5 * full, full[:, 0])
        state = CraneCourse(*(values[np.newaxis].copy() for values in parts))
        twice = CraneCourse(*(np.concatenate((values, values)) for values in state))
        memory = self._mechanics.memory(_begin(state))
        found = self._mechanics.mechanics(0, twice, memory)
        piston = -found.load[0] / found.cylinder[0, ..., 1]
        a, b, supply, tank = (
            circuit.area_a, circuit.area_b, circuit.supply_pressure, circuit.tank_pressure
        )  # fmt: skip
        p_a = (piston + b * (supply + tank)) / (a + b)
        p_a = np.clip(p_a, np.maximum(tank, (piston + b * tank) / a), supply)
        p_b = (a * p_a - piston) / b
        if not ((p_a >= tank) & (p_b >= tank) & (p_b <= supply)).all():
            n, j = np.argwhere((p_a < tank) | (p_b < tank) | (p_b > supply))[0]
            raise RangeError(
                f"{joints[j]}: its weight asks for {piston[n, j]:.0f} N of its cylinder, more than "
                f"the supply of {supply:.4g} Pa can hold; start from another pose"
            )
        state.chamber_a[0], state.chamber_b[0] = p_a, p_b
        return state


def _begin(course: CraneCourse) -> CraneState:
    return CraneState(
        course.position[0], course.velocity[0], course.chamber_a[0], course.chamber_b[0]
    )
