"""The whole crane from its valves: forward simulation of mechanics (16) and oil, many runs beside.

The terms of the model, whatever they are, say what the mechanics is at every instant of a stretch
of motion, all at once; about these, linear from one to the next, valves, chambers, supply and dry
friction are stepped in compiled code; and the terms are asked again, along the motion that this
gave, until it stays. The piston follows the flow, so that two or three passes do.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from crane_model.actuators.cylinders import Chambers
from crane_model.array import Array
from crane_model.errors import ConfigurationError, RangeError
from crane_model.hydraulics.stepping import (
    Circuit,
    CraneCourse,
    Mechanics,
    advance,
    openings,
    spool_course,
    trailing,
)
from crane_model.hydraulics.values import ChamberValues, HydraulicValues, ValveValues
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term

SUBSTEP = 2.5e-4  # s, at most: a fiftieth of the fastest oscillation of oil and booms
STRETCH = 50  # instants whose mechanics is asked for at once
PASSES = 8  # at most
SETTLED = 1e-7  # rad or m, by which the last pass may still change a position
STOP = 1e9  # N m, N: what a stop can hold
NUDGE = 1e-4  # of velocity, rad/s or m/s, for the slope of the forces


@dataclass(frozen=True)
class CraneState:
    """N runs of j joints, of the model and in its order."""

    position: Array  # (N, j) rad or m
    velocity: Array  # (N, j)
    pressure_a: Array  # (N, j) Pa
    pressure_b: Array  # (N, j) Pa


def substeps(period: float) -> int:
    """How many openings `simulate_openings` wants from an instant to the next."""
    return int(np.ceil(period / SUBSTEP - 1e-9))


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
    return openings(edges, valve.dead_zone_a.value, valve.dead_zone_b.value)


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
    asking = ModelMechanics(model, beside or {}, period, circuit_of(model))
    runs, joints = start.position.shape
    states = asking.memory(start)
    stretch = 1 if states else STRETCH  # a memory is advanced from instant to instant
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
    for number in range(PASSES):
        mechanics = asking.mechanics(k, course, memory)
        advance(asking.circuit, mechanics, between, step, course)
        change = float(np.abs(course.position - asked).max())
        if not np.isfinite(change):
            raise RangeError(
                f"simulation of '{asking.model.name}': the motion grows beyond all bounds; its "
                "values are not physical"
            )
        if change < SETTLED or (len(between) == 1 and number):
            return
        asked = course.position.copy()


def circuit_of(model: Model) -> Circuit:
    """The constants of the circuit; `ConfigurationError` names what is not identified of it."""
    machine, known = identified(model)
    valves, chambers = zip(*(_parts(model, known, joint) for joint in model.joints), strict=True)
    cylinders = [machine.cylinders[joint] for joint in model.joints]
    parts: dict[str, Array] = {}
    for name in Circuit._fields[:-3]:
        for group in (valves, chambers):
            if name in group[0].units:
                parts[name] = np.array([getattr(one, name).value for one in group])
        if name not in parts:
            where = [one.chambers if name in Chambers._fields else one for one in cylinders]
            parts[name] = np.array([getattr(one, name) for one in where])
    pressure, droop = machine.hydraulics.supply_pressure, 0.0
    if known.supply is not None:
        pressure, droop = known.supply.pressure.value, known.supply.droop.value
    return Circuit(
        **parts,
        supply_pressure=pressure,
        droop=droop,
        tank_pressure=machine.hydraulics.tank_pressure,
    )


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
        why = known.unknown.get(joint, "recordings with its chamber pressures would tell")
        raise ConfigurationError(
            f"model '{model.name}': the hydraulics of {joint} are not identified: {why}"
        )
    return values.valve, values.chambers


@dataclass(frozen=True)
class ModelMechanics:
    """What the terms of the model say of the mechanics at an instant."""

    model: Model
    beside: Mapping[str, Array]
    period: float
    circuit: Circuit
    held: Array | None = None  # (N, j): joints that a stop holds

    def memory(self, start: CraneState) -> dict[Term, Array]:
        """The states in which terms that have some begin."""
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
            velocity[joints + 2 + j, :, j] += NUDGE
        direction[joints + 1] = 1.0
        one = self._record(k, asked, cylinder)
        rows = np.tile(np.arange(instants * runs), cases)
        record = replace(
            one.take(rows),
            velocity=velocity.reshape(-1, joints),
            acceleration=acceleration.reshape(-1, joints),
            direction_known=direction.reshape(-1, joints),
            memory={term: np.tile(state, (cases, 1)) for term, state in memory.items()},
        )
        force = self.model.predict(record).reshape(cases, -1, joints)
        rest = force[joints]
        mass = (force[:joints] - rest).transpose(1, 2, 0)
        damping = (force[joints + 2 :] - rest).transpose(1, 2, 0) / NUDGE
        shape = (instants, runs, joints)
        dry = np.maximum(force[joints + 1] - rest, 0.0).reshape(shape)
        if self.held is not None:
            dry[:, self.held] = STOP
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
        """Of mass matrices (n, j, j); `RangeError` if one is not positive definite."""
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
        assert machine is not None  # checked by `circuit_of`
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
