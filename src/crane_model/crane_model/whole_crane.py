"""The whole crane from its valves: forward simulation of mechanics (16) and oil, many runs at once.

Between instants the mechanics is held linear about the state, as the terms of the model have it
there, whatever terms these are; valves, chambers, supply and dry friction are stepped in between in
compiled code. The piston follows the flow, so that motion hardly depends on how often the mechanics
is asked.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crane_model.array import Array
from crane_model.errors import ConfigurationError, RangeError
from crane_model.hydraulics.spool import openings, spool_course, trailing
from crane_model.hydraulics.stepping import Circuit, Mechanics, OilPressures, advance
from crane_model.hydraulics.values import ChamberValues, HydraulicValues, ValveValues
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term

SUBSTEP = 2.5e-4  # s, at most: a fiftieth of the fastest oscillation of oil and booms
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
        valve.natural_frequency.value,
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
    circuit = circuit_of(model)
    asking = _Asking(model, beside or {}, period, circuit)
    q, v = np.array(start.position, dtype=float), np.array(start.velocity, dtype=float)
    oil = OilPressures(
        np.array(start.pressure_a, dtype=float),
        np.array(start.pressure_b, dtype=float),
        np.full(len(q), circuit.supply_pressure),
    )
    states: dict[Term, Array] = {}
    first = asking.record(0, q, v, oil)
    for term in model.terms:
        begun = term.start(first, model.setting)
        if begun.shape[1]:
            states[term] = begun
    positions, velocities = [q.copy()], [v.copy()]
    step = period / opened.shape[1]
    for k, between in enumerate(opened):
        before = asking.record(k, q, v, oil) if states else None
        mechanics = asking.mechanics(k, q, v, oil, states)
        advance(circuit, mechanics, np.ascontiguousarray(between), step, q, v, oil)
        if before is not None:
            after = asking.record(k + 1, q, v, oil)
            states = {
                term: term.advance(state, before, after, model.setting)
                for term, state in states.items()
            }
        positions.append(q.copy())
        velocities.append(v.copy())
    return np.stack(positions), np.stack(velocities)


def circuit_of(model: Model) -> Circuit:
    """The constants of the circuit; `ConfigurationError` names what is not identified of it."""
    machine, known = _identified(model)
    valves, chambers = zip(*(_parts(model, known, joint) for joint in model.joints), strict=True)
    cylinders = [machine.cylinders[joint] for joint in model.joints]
    parts: dict[str, Array] = {}
    for name in Circuit._fields[:-3]:
        for group in (valves, chambers):
            if name in group[0].units:
                parts[name] = np.array([getattr(one, name).value for one in group])
        if name not in parts:
            parts[name] = np.array([getattr(one, name) for one in cylinders])
    pressure, droop = machine.hydraulics.supply_pressure, 0.0
    if known.supply is not None:
        pressure, droop = known.supply.pressure.value, known.supply.droop.value
    return Circuit(
        **parts,
        supply_pressure=pressure,
        droop=droop,
        tank_pressure=machine.hydraulics.tank_pressure,
    )


def _identified(model: Model) -> tuple[Machine, HydraulicValues]:
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
class _Asking:
    """What the terms of the model say of the mechanics at an instant."""

    model: Model
    beside: Mapping[str, Array]
    period: float
    circuit: Circuit

    def record(self, k: int, q: Array, v: Array, oil: OilPressures) -> Record:
        """The N runs at instant k."""
        return self._record(k, q, v, oil, self._cylinder(q), np.zeros_like(v), None, 1)

    def mechanics(
        self, k: int, q: Array, v: Array, oil: OilPressures, memory: Mapping[Term, Array]
    ) -> Mechanics:
        """Linear about the state, from one evaluation of the model on 2 j + 2 stacked cases."""
        runs, joints = q.shape
        cases = 2 * joints + 2
        nudged = np.tile(v, (cases, 1, 1))
        acceleration, direction = np.zeros((2, cases, runs, joints))
        for j in range(joints):
            acceleration[j, :, j] = 1.0
            nudged[joints + 2 + j, :, j] += NUDGE
        direction[joints + 1] = 1.0
        cylinder = self._cylinder(q)
        record = self._record(
            k,
            q,
            nudged.reshape(-1, joints),
            oil,
            cylinder,
            acceleration.reshape(-1, joints),
            direction.reshape(-1, joints),
            cases,
            memory,
        )
        force = self.model.predict(record).reshape(cases, runs, joints)
        rest = force[joints]
        try:
            inverse = np.linalg.inv((force[:joints] - rest).transpose(1, 2, 0)).astype(float)
        except np.linalg.LinAlgError:
            inverse = np.full((runs, joints, joints), np.nan)
        if not (np.isfinite(inverse).all() and (np.einsum("njj->nj", inverse) > 0.0).all()):
            raise RangeError(
                f"simulation of '{self.model.name}': the mass matrix is not positive definite; the "
                "inertial values of the model are not physical, or the motion has grown beyond "
                "all bounds"
            )
        return Mechanics(
            position=q.copy(),
            velocity=v.copy(),
            inverse=inverse,
            load=-rest,
            damping=np.ascontiguousarray((force[joints + 2 :] - rest).transpose(1, 2, 0) / NUDGE),
            dry=np.maximum(force[joints + 1] - rest, 0.0),
            cylinder=cylinder,
        )

    def _cylinder(self, q: Array) -> Array:
        """(N, j, 3) length, lever arm and its derivative; `RangeError` outside the linkages."""
        machine = self.model.machine
        assert machine is not None  # checked by `circuit_of`
        parts = [machine.cylinder(joint, q[:, j]) for j, joint in enumerate(self.model.joints)]
        cylinder = np.stack(parts, axis=1)
        if not np.isfinite(cylinder).all():
            joint = self.model.joints[int(np.argwhere(~np.isfinite(cylinder))[0, 1])]
            raise RangeError(
                f"simulation of '{self.model.name}': {joint} left the range in which its linkage "
                "can be assembled"
            )
        return cylinder

    def _record(
        self,
        k: int,
        q: Array,
        v: Array,
        oil: OilPressures,
        cylinder: Array,
        acceleration: Array,
        direction: Array | None,
        cases: int,
        memory: Mapping[Term, Array] | None = None,
    ) -> Record:
        def stacked(values: Array) -> Array:
            return np.concatenate([values] * cases) if cases > 1 else values

        p_a, p_b, circuit = oil.chamber_a, oil.chamber_b, self.circuit
        signals = {
            "time": np.full(len(q), k * self.period),
            "force": cylinder[:, :, 1] * (circuit.area_a * p_a - circuit.area_b * p_b),
            "pressure_a": p_a,
            "pressure_b": p_b,
            "supply_pressure": oil.supply,
            "tank_pressure": np.full(len(q), circuit.tank_pressure),
        } | {name: values[k] for name, values in self.beside.items()}
        return Record(
            joints=self.model.joints,
            position=stacked(q),
            velocity=v,
            acceleration=acceleration,
            direction_known=direction,
            memory={term: stacked(state) for term, state in (memory or {}).items()},
            **{name: stacked(values) for name, values in signals.items()},
        )
