"""The sensors of the machine and its motion as they show it."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit

from crane_model.machine import Machine
from crane_model.sensors import SensorChain, in_counts
from crane_sim.effects.form import InjectedForm, SensorFault, measured_joints
from crane_sim.parts.parameters import SimulatedCrane
from crane_sim.sensor_faults import Faults

REMEMBERED_S = 1.0  # of the motion, more than any latency


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
        """Run for `duration` [s] with valve commands (j,) in -1..1; positive moves a joint up."""

    def leak(self, passed: np.ndarray) -> None:
        """From now on pistons let (j,) more oil through, m3/(s Pa); `RangeError` if none can."""


class RecordedMachine(MachineInMotion, Protocol):
    """One of which recordings tell what truly happened; k injected effects act in it."""

    @property
    def parameters(self) -> SimulatedCrane:
        """Parameters of the machine; its sensors are those of recordings."""

    @property
    def time(self) -> float:
        """Since the machine was started [s]."""

    @property
    def v(self) -> np.ndarray:
        """(j,) rad/s, m/s."""

    @property
    def acceleration(self) -> np.ndarray:
        """(j,) rad/s2, m/s2."""

    @property
    def injected_force(self) -> np.ndarray:
        """(k, j) what each injected effect asks of the drives [N m, N]."""

    @property
    def injected_flow(self) -> np.ndarray:
        """(k, j) what flows more into chamber A for each injected effect [m3/s]."""


Build = Callable[[np.ndarray, Sequence[InjectedForm], float], RecordedMachine]
"""Makes a machine that rests at (j,) [rad, m], with effects, and has run for a time [s]."""


class Pressures(NamedTuple):
    """Readings of n samples [Pa]; columns are the cylinders that have transducers."""

    chamber_a: np.ndarray  # (n, k)
    chamber_b: np.ndarray  # (n, k)
    supply: np.ndarray  # (n,)
    tank: np.ndarray  # (n,)


class InertialSensors:
    """Joint angles of inertial sensors on the links: biased, noisy, shaken and late.

    `SensorChain.inertial` describes the sensors; the same seed gives the same noise.
    """

    def __init__(self, chain: SensorChain, machine: Machine, seed: int):
        self._rng = np.random.default_rng([seed, 12])
        self._sensors = list(chain.inertial.values())
        self._columns = [machine.index(joint) for joint in chain.inertial]
        self._past: list[tuple[float, np.ndarray]] = []

    def shown(self, q: np.ndarray, time: float) -> np.ndarray:
        """(j,) angles shown at a time [s] of coordinates (j,); times rise. Others stay."""
        if not self._sensors:
            return q
        self._past.append((time, np.cumsum(q[self._columns])))
        while self._past[0][0] < time - REMEMBERED_S:
            self._past.pop(0)
        times, pitches = (np.array(part) for part in zip(*self._past, strict=True))
        pitch = np.array(
            [
                np.interp(time - sensor.latency, times, pitches[:, k])
                + sensor.bias
                + sensor.noise * self._rng.standard_normal()
                + sensor.vibration * np.sin(2.0 * np.pi * sensor.frequency * time + k)
                for k, sensor in enumerate(self._sensors)
            ]
        )
        shown = q.copy()
        shown[self._columns] = np.diff(pitch, prepend=0.0)
        return shown


class Sensors:
    """The sensors of the simulated crane; the same seed gives the same noise and jitter.

    The one place where true signals become readings: `faults` are what else the sensors do wrong,
    one after the other, before noise and converters, and `flaws` what belongs to the noise; `timed`
    are those that begin later, behind both, and those of valves.
    """

    def __init__(
        self,
        chain: SensorChain,
        machine: Machine,
        seed: int,
        faults: Sequence[SensorFault] = (),
        timed: Faults | None = None,
        flaws: Sequence[SensorFault] = (),
    ):
        self._chain = chain
        self.faults = tuple(faults)
        self._wrong = (*faults, *flaws)
        self.timed = timed or Faults(machine)
        self._rng = np.random.default_rng(seed)
        self._inertial = InertialSensors(chain, machine, seed)
        self._counts = chain.counts(machine.joint_names)
        self.cylinders = measured_joints(machine)
        self._fitted = np.array([machine.index(joint) for joint in self.cylinders], dtype=int)

    def instants(self, start: float, count: int) -> np.ndarray:
        """(count,) sampling instants [s], one period apart but for jitter."""
        return self._chain.sample_times(self._rng, start, count)

    def positions(self, q: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Readings of the coordinates (j,) [rad, m] at a time [s]; times rise."""
        q = self._inertial.shown(q, time)
        for fault in self._wrong:
            q = fault.positions(q)
        read = in_counts(q, self._counts)
        shown = self.timed.positions(time, read)
        return read if shown is read else in_counts(shown, self._counts)

    def pressures(
        self,
        chamber_a: np.ndarray,
        chamber_b: np.ndarray,
        supply: np.ndarray,
        tank: float,
        time: np.ndarray | None = None,
    ) -> Pressures:
        """Transducer readings of true pressures (n, j), (n, j), (n,) and the tank's [Pa].

        `time` (n,) [s] is when they are read, by default all at once.
        """
        if time is None:
            time = np.zeros(len(supply))
        for fault in self._wrong:
            chamber_a, chamber_b = fault.pressures(time, chamber_a, chamber_b)
        true = _gathered(
            np.ascontiguousarray(chamber_a), np.ascontiguousarray(chamber_b),
            np.ascontiguousarray(supply), tank, self._fitted,
        )  # fmt: skip
        read = self._chain.measure_pressure(self._rng, true)
        n, k = len(supply), len(self._fitted)
        read_a, read_b = read[: 2 * n * k].reshape(2, n, k)
        read_supply, read_tank = read[2 * n * k :].reshape(2, n)
        shown_a, shown_b, shown = self.timed.pressures(time, read_a, read_b, read_supply)
        if shown_a is read_a:  # nothing fails
            return Pressures(read_a, read_b, read_supply, read_tank)
        convert = self._chain.converted
        return Pressures(convert(shown_a), convert(shown_b), convert(shown), read_tank)


@njit(cache=True, error_model="numpy")
def _gathered(
    chamber_a: np.ndarray,
    chamber_b: np.ndarray,
    supply: np.ndarray,
    tank: float,
    fitted: np.ndarray,
) -> np.ndarray:
    """Pressures of all transducers one behind the other: A, B, supply and tank of n samples [Pa].

    Compiled, and in one array: for a few numbers, every call of numpy costs more than they do.
    """
    n, k = len(supply), len(fitted)
    pressure = np.empty(2 * n * (k + 1))
    for row in range(n):
        for column in range(k):
            pressure[row * k + column] = chamber_a[row, fitted[column]]
            pressure[(n + row) * k + column] = chamber_b[row, fitted[column]]
        pressure[2 * n * k + row] = supply[row]
        pressure[2 * n * k + n + row] = tank
    return pressure
