"""The plant of the other make: MuJoCo's bodies under oil, valves and friction of its own."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from crane_benchmark.independent.effects import pack_injected
from crane_benchmark.independent.parts import Make, MujocoBodies, pack_independent
from crane_benchmark.independent.stepping import IndependentState, run_independent
from crane_model.cylinders import lever_arms
from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_sim.effects.form import InjectedForm
from crane_sim.parts.parameters import (
    SimulatedCrane,
    vary,
    vary_hydraulics,
    vary_sensors,
    vary_valves,
)
from crane_sim.plant.sampled import Build

BODIES_STEP = 3e-3  # s, at most, in which inertia and bias are held: twice a cycle that jitters
OIL_STEP = 1e-4  # s, at most
SPREAD = 0.3  # of masses, friction and leakage
OF_VALVES = 0.15  # of spools, rated flows, hoses and supply line
OF_SENSORS = 0.3  # of noise and jitter
UNPRESSURIZED_MODULUS = (
    1.2e9,
    1.6e9,
)  # Pa, of the oil without pressure: with its air it stays usual
AIR = (2e-4, 1.5e-3)  # share of the volume at atmospheric pressure
STIFFENING = (3.0, 8.0)  # Pa per Pa
PUMP_LAG = (5e-3, 1.5e-2)  # s


class IndependentPlant:
    """A `RecordedMachine` that starts at rest at `q0` (j,) with spools in the middle and pressures
    that carry gravity, of which those of a cylinder add up to the supply's where they can.
    """

    def __init__(
        self,
        parameters: SimulatedCrane,
        machine: Machine,
        make: Make,
        q0: np.ndarray,
        injected: Sequence[InjectedForm] = (),
        running: float = 0.0,
    ):
        """`running` [s] since the start. `RangeError` if the pump cannot hold it at q0."""
        self.parameters, self.machine = parameters, machine
        self.tank_pressure = machine.hydraulics.tank_pressure
        self._bodies = MujocoBodies(parameters, machine)
        self._parts = pack_independent(parameters, machine, make)
        self._leakage = self._parts.leakage.copy()
        self._hidden = pack_injected(injected, machine)
        joints, supply = len(q0), machine.hydraulics.supply_pressure
        self._state = IndependentState(
            q=np.array(q0, dtype=float),
            v=np.zeros(joints),
            spool=np.zeros((joints, 2)),
            bristle=np.zeros(joints),
            pressure=self._carrying(np.asarray(q0, dtype=float), supply),
            supply=np.array([supply, 0.0]),
            clock=np.array([running]),
            push=np.zeros(joints),
        )
        self.acceleration = np.zeros(joints)
        """(j,) at the end of the last `advance` [rad/s2, m/s2]."""

    def advance(self, command: np.ndarray, duration: float) -> None:
        """Run for `duration` [s] with valve commands (j,) in -1..1; positive moves a joint up.

        `RangeError` if a command is not finite, or a linkage was forced open.
        """
        command = np.ascontiguousarray(command, dtype=float)
        if not np.isfinite(command).all():
            raise RangeError(f"valve command {command}: must be finite, in -1..1 for each joint")
        state = self._state
        count = max(1, math.ceil(duration / BODIES_STEP - 1e-6))
        held = duration / count
        fine = math.ceil(held / OIL_STEP - 1e-6)
        for _ in range(count):
            mass, bias = self._bodies.at(state.q + 0.5 * held * state.v, state.v)
            inverse = np.linalg.inv(mass)
            run_independent(
                self._parts, self._hidden, state, inverse, bias, command, held / fine, fine
            )
        mass, bias = self._bodies.at(state.q, state.v)
        self.acceleration = np.linalg.solve(mass, state.push - bias)
        if not np.isfinite(state.q).all():
            raise RangeError(
                f"plant of other make: a linkage was forced open before t = {self.time:.4f} s; "
                "lead it more slowly, or stay away from the ends of its strokes"
            )

    def leak(self, passed: np.ndarray) -> None:
        """From now on pistons let `passed` (j,) more oil through, m3/(s Pa)."""
        self._parts.leakage[:] = self._leakage + passed

    @property
    def time(self) -> float:
        return float(self._state.clock[0])

    @property
    def q(self) -> np.ndarray:
        """(j,) coordinates [rad, m]; this and the others from the base to the tip."""
        return self._state.q.copy()

    @property
    def v(self) -> np.ndarray:
        return self._state.v.copy()

    @property
    def pressure_a(self) -> np.ndarray:
        return self._state.pressure[:, 0].copy()

    @property
    def pressure_b(self) -> np.ndarray:
        return self._state.pressure[:, 1].copy()

    @property
    def supply_pressure(self) -> float:
        return float(self._state.supply[0])

    @property
    def injected_force(self) -> np.ndarray:
        """(k, j) what each hidden effect asked of the drives in the last step [N m, N]."""
        return self._hidden.part.copy()

    @property
    def injected_flow(self) -> np.ndarray:
        """(k, j) what flows more into chamber A for each hidden effect [m3/s]: nothing."""
        return np.zeros_like(self._hidden.part)

    def _carrying(self, q: np.ndarray, supply: float) -> np.ndarray:
        """(j, 2) pressures that hold the crane at q (j,) [Pa]."""
        machine, tank, (area_a, area_b) = self.machine, self.tank_pressure, self._parts.areas.T
        weight = self._bodies.at(q, np.zeros(len(q)))[1]
        piston = weight / lever_arms(machine, q[np.newaxis], machine.joint_names)[0]
        p_a = (piston + area_b * (supply + tank)) / (area_a + area_b)
        p_a = np.clip(p_a, tank, supply)
        p_b = (area_a * p_a - piston) / area_b
        low = p_b < tank
        p_b[low] = tank
        p_a[low] = ((piston + area_b * tank) / area_a)[low]
        pressure = np.column_stack([p_a, p_b])
        held = ((pressure >= tank) & (pressure <= supply)).all(axis=1)
        if not held.all():
            i = int(np.argmin(held))
            raise RangeError(
                f"{machine.joint_names[i]}: at {np.round(q, 4).tolist()} gravity needs "
                f"{piston[i]:.0f} N (N m of a motor), more than the supply pressure of "
                f"{supply:.4g} Pa can hold; start from another pose"
            )
        return pressure


# Machines of the other make, drawn: parameters, valves, oil and pump.


def drawn_independent(
    simulated: SimulatedCrane, machine: Machine, seed: int
) -> tuple[SimulatedCrane, Build]:
    """A machine about `simulated`, and its parts; the same seed gives the same one."""
    rng = np.random.default_rng([seed, 5])  # not the draws of `vary`
    drawn = vary_sensors(vary(simulated, seed, SPREAD), seed, OF_SENSORS)
    drawn = vary_valves(vary_hydraulics(drawn, seed, OF_VALVES), machine, seed)
    oil = drawn.oil.model_copy(update={"bulk_modulus": float(rng.uniform(*UNPRESSURIZED_MODULUS))})
    drawn = drawn.model_copy(update={"oil": oil})
    make = Make(
        air=float(rng.uniform(*AIR)),
        stiffening=float(rng.uniform(*STIFFENING)),
        pump_lag=float(rng.uniform(*PUMP_LAG)),
    )
    return drawn, partial(IndependentPlant, drawn, machine, make)
