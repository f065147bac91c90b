"""The sensor chain: what encoders and pressure transducers make of the true signals."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array
from crane_model.configuration import NonNegative, Positive, Schema
from crane_model.machine import Machine


def in_counts(q: Array, counts: Array) -> Array:
    """Coordinates q (..., j) rounded to whole `counts` (j,) [rad, m]."""
    shown: Array = counts * np.rint(np.asarray(q) / counts)
    return shown


def at_one_time(time: Array, position: Array, latency: Array) -> tuple[Array, Array]:
    """When joints were where their readings show them: times (n,) [s] and positions (n, j).

    Readings (n, j) have stamps `time` (n,) [s] and are older by `latency` (j,) [s]. All are given
    for the times of the oldest; younger ones are interpolated.
    """
    wait = latency.max() - latency
    shown = position.copy()
    for k in np.flatnonzero(wait):
        shown[:, k] = np.interp(time - wait[k], time, position[:, k])
    return time - latency.max(), shown


@njit(cache=True, error_model="numpy")
def _converted(pressure: Array, full_scale: float, step: float) -> Array:
    """Pressures (n,) limited to 0 and `full_scale`, in whole steps [Pa]."""
    shown = np.empty_like(pressure)
    for k, true in enumerate(pressure):
        limited = 0.0 if true < 0.0 else full_scale if true > full_scale else true
        shown[k] = np.rint(limited / step) * step
    return shown


class InertialSensor(Schema):
    """The pitch of a link by an inertial measurement unit (IMU).

    The angle of a joint is its link's pitch less that of the link before with such a sensor.
    """

    bias: float  # rad, that calibration left
    noise: NonNegative  # rad, rms
    latency: NonNegative  # s, by which what it shows is old
    vibration: NonNegative  # rad, amplitude of what shakes the link
    frequency: Positive  # Hz, of it


class SensorChain(Schema):
    """Encoders, pressure transducers with their converter, and the clock that samples them.

    Joints with an `inertial` sensor have no encoder: their resolution is that of the bus.
    """

    encoder_resolution: dict[str, Positive]  # of each joint, one count [rad or m]
    inertial: dict[str, InertialSensor] = {}  # in the order of the joints
    pressure_noise: NonNegative  # Pa, rms before the converter
    pressure_range: Positive  # Pa, full scale; readings saturate at 0 and here
    pressure_bits: Annotated[int, Field(ge=8, le=24)]
    jitter: NonNegative  # s, rms of the sampling instant
    period: Positive  # s

    @property
    def pressure_step(self) -> float:
        """One count of the converter [Pa]."""
        return float(self.pressure_range / (2**self.pressure_bits - 1))

    def sample_times(self, rng: np.random.Generator, start: float, count: int) -> Array:
        """(count,) increasing sampling instants [s]; jitter never reorders them."""
        limit = 0.45 * self.period
        deviation = np.clip(self.jitter * rng.standard_normal(count), -limit, limit)
        return start + self.period * np.arange(count) + deviation

    def counts(self, joints: Sequence[str]) -> Array:
        """(j,) one count of the encoder of each joint [rad, m]."""
        return np.array([self.encoder_resolution[joint] for joint in joints])

    def equivalent_counts(self, joints: Sequence[str]) -> Array:
        """(j,) one count of an encoder as noisy as the position of each joint [rad, m].

        Of an inertial sensor, noise and vibration are added to the rounding.
        """
        counts = self.counts(joints)
        before: InertialSensor | None = None
        for i, joint in enumerate(joints):
            own = self.inertial.get(joint)
            if own is None:
                continue
            sensors = [sensor for sensor in (own, before) if sensor is not None]
            power = sum(sensor.noise**2 + sensor.vibration**2 / 2.0 for sensor in sensors)
            counts[i] = np.sqrt(counts[i] ** 2 + 12.0 * power)
            before = own
        return counts

    def measure_pressure(self, rng: np.random.Generator, pressure: Array) -> Array:
        """Transducer readings of any shape [Pa]: noise, saturation, quantisation."""
        pressure = np.asarray(pressure, dtype=float)
        return self.converted(pressure + self.pressure_noise * rng.standard_normal(pressure.shape))

    def converted(self, pressure: Array) -> Array:
        """Pressures of any shape [Pa] as the converter shows them: saturated and quantised."""
        flat = np.ascontiguousarray(pressure, dtype=float).ravel()
        shown: Array = _converted(flat, self.pressure_range, self.pressure_step)
        return shown.reshape(np.shape(pressure))

    def force_noise(self, machine: Machine, joint: str) -> float:
        """Standard deviation of a cylinder force (19) that noise and quantisation cause [N]."""
        cylinder = machine.cylinders[joint]
        pressure = np.hypot(self.pressure_noise, self.pressure_step / np.sqrt(12.0))
        return float(pressure * np.hypot(cylinder.area_a, cylinder.area_b))
