"""Online identification without ROS: readings go in, estimates and forces come out."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_identification.online.correlation import ResidualCorrelation
from crane_identification.online.gate import Gate
from crane_identification.online.matching import Matched, Matcher
from crane_identification.online.recursion import Recursion, Solution
from crane_identification.online.smoother import NANOSECONDS, FixedLagSmoother, Smoothed
from crane_model.configuration import load, packaged
from crane_model.cylinders import generalized_forces
from crane_model.errors import ConfigurationError, DataError, RangeError
from crane_model.machine import JOINTS, Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.sensors import SensorChain

REFRESH = NANOSECONDS  # between two weightings of the joints for the prediction
NOTHING = np.empty(0)
GAP_SHARE = 0.125  # of the lag: readings that the fine smoother needs
FINE = 0.25  # of lag and period: the smoother whose velocity opens the gate


@dataclass(frozen=True)
class OnlineOptions:
    """Choices of online identification; times in s.

    `lag` is half the window of the smoother, `period` that of the rows (more of them tell nothing
    new: their windows overlap), `largest_gap` what may be missing before a new run begins, at most
    an eighth of the lag. `forgetting` is the factor λ per row: the memory is period/(1 - λ).
    `encoder_resolution` (j,) [rad or m] is one count of the encoder of each joint of the model;
    None: those of the laboratory crane.
    """

    lag: float = 0.2
    period: float = 0.05
    forgetting: float = 1.0
    largest_gap: float = 0.025
    encoder_resolution: tuple[float, ...] | None = None


class Forces(NamedTuple):
    """Generalized forces (j,) [N m or N] at `stamp` [ns], both behind the smoother.

    `predicted` is NaN while the parameters are not all determined; `used` (j,) says whose rows the
    estimate learned from.
    """

    stamp: int
    measured: np.ndarray
    predicted: np.ndarray
    used: np.ndarray


class OnlineEstimator:
    """Θ of a model from encoder and pressure readings, in any interleaving of the two streams.

    The standard deviations take the residual of each joint as an autoregression (see
    `ResidualCorrelation`): smoothed forces are correlated from row to row, and counting every row
    as independent would make them several times too narrow. What they do not cover is a bias from
    effects that the model lacks.
    """

    def __init__(self, model: Model, options: OnlineOptions | None = None):
        """`ConfigurationError` if the model has no machine or the options do not fit it."""
        self.model = model
        self.options = options or OnlineOptions()
        if model.machine is None:
            raise ConfigurationError(
                f"model '{model.name}': has no machine, so that forces cannot be computed from "
                f"pressures (27); name one in the model file"
            )
        _check(self.options)
        self._machine: Machine = model.machine
        self._noise = _resolution(model, self.options) / np.sqrt(12)
        self.reset()

    def reset(self) -> None:
        """Forget everything that was learned and counted."""
        o, joints = self.options, len(self.model.joints)
        self.matcher = Matcher(round(o.largest_gap * NANOSECONDS))
        self.smoother = FixedLagSmoother(joints, o.lag, o.period, o.largest_gap)
        self._fine = FixedLagSmoother(joints, FINE * o.lag, FINE * o.period, o.largest_gap)
        self._gate = Gate(self._noise, round(o.lag * NANOSECONDS))
        self._recursion = Recursion(joints, len(self.model.parameters), o.forgetting)
        self._correlation = ResidualCorrelation(joints)
        self._solution = self._recursion.solve()
        self._run = -1
        self.stamp = 0  # ns, of the newest row
        self.rows = 0  # instants that came out of the gate
        self.invalid = 0  # readings that are not finite or outside what the linkages can reach

    def add_position(self, stamp: int, position: np.ndarray) -> list[Forces]:
        """Encoder readings (j,) of the model's joints, stamped in ns; what they complete."""
        if not np.isfinite(position).all():
            self.invalid += 1
            return []
        return self._process(self.matcher.add_position(stamp, position))

    def add_pressure(
        self, stamp: int, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> list[Forces]:
        """Chamber pressures (j,) [Pa gauge] of the model's joints; what they complete."""
        pressure = np.concatenate([chamber_a, chamber_b])
        if not np.isfinite(pressure).all():
            self.invalid += 1
            return []
        return self._process(self.matcher.add_pressure(stamp, pressure))

    @property
    def samples(self) -> int:
        """Rows that the estimate rests on."""
        return self._recursion.samples

    @property
    def gated_share(self) -> float:
        """Share of the rows that were not used; NaN without any."""
        total = self.rows * len(self.model.joints)
        return 1.0 - self.samples / total if total else np.nan

    def solve(self) -> Solution:
        """The estimate on all rows so far."""
        return self._recursion.solve(self._correlation.factors())

    def fitted_model(self) -> Model:
        """The model with the present estimate; `DataError` names what is not determined yet."""
        solution = self.solve()
        if not solution.determined.all():
            names = np.array([p.name for p in self.model.parameters])[~solution.determined]
            raise DataError(
                f"model '{self.model.name}': {self.samples} rows do not determine "
                f"{', '.join(names)}; excite the joints more, or longer"
            )
        provenance = (
            f"recursive least squares, forgetting {self.options.forgetting:g}, {self.samples} rows"
        )
        return self.model.with_estimate(solution.values, solution.std_devs, provenance)

    def _process(self, matched: list[Matched]) -> list[Forces]:
        out = []
        joints = len(self.model.joints)
        for stamp, position, pressure in matched:
            pressure_a, pressure_b = pressure[np.newaxis, :joints], pressure[np.newaxis, joints:]
            try:
                force = generalized_forces(
                    self._machine, position[np.newaxis], pressure_a, pressure_b
                )[0]
            except RangeError:
                self.invalid += 1
                continue
            for row in self.smoother.add(stamp, position, np.concatenate([force, pressure])):
                self._gate.add_row(row)
            for fine in self._fine.add(stamp, position, NOTHING):
                out += [self._learn(*decided) for decided in self._gate.add_velocity(fine)]
        return out

    def _learn(self, smoothed: Smoothed, used: np.ndarray) -> Forces:
        """Predict the row with what is known, then learn from it."""
        columns = self.model.regressor(self._record(smoothed))[0]
        force = smoothed.carried[: len(used)]
        predicted = np.full(len(used), np.nan)
        if smoothed.run != self._run:
            self._run = smoothed.run
            self._correlation.interrupt()
        if self._solution.determined.all():
            predicted = columns @ self._recursion.values(self._solution.weights)
            self._correlation.add(force - predicted, used)
        self._recursion.update(columns, force, used)
        if smoothed.stamp // REFRESH != self.stamp // REFRESH:
            self._solution = self.solve()
        self.stamp = smoothed.stamp
        self.rows += 1
        return Forces(smoothed.stamp, force, predicted, used)

    def _record(self, smoothed: Smoothed) -> Record:
        joints = len(self.model.joints)
        pressure_a, pressure_b = np.split(smoothed.carried[joints:], 2)
        return Record(
            joints=self.model.joints,
            time=np.array([smoothed.stamp / NANOSECONDS]),
            position=smoothed.position[np.newaxis],
            velocity=smoothed.velocity[np.newaxis],
            acceleration=smoothed.acceleration[np.newaxis],
            force=smoothed.carried[np.newaxis, :joints],
            pressure_a=pressure_a[np.newaxis],
            pressure_b=pressure_b[np.newaxis],
            velocity_resolution=self._gate.resolution(smoothed),
        )


def _check(options: OnlineOptions) -> None:
    if not 0.0 < options.forgetting <= 1.0:
        raise ConfigurationError(
            f"forgetting must be above 0 and at most 1, got {options.forgetting}"
        )
    if not 0.0 < options.period <= options.lag:
        raise ConfigurationError(
            f"period must be above 0 and at most the lag, {options.lag} s, got {options.period} s"
        )
    if not 0.0 < options.largest_gap <= GAP_SHARE * options.lag:
        raise ConfigurationError(
            f"largest gap must be above 0 and at most an eighth of the lag, "
            f"{GAP_SHARE * options.lag:g} s, got {options.largest_gap} s; smooth over longer, or "
            f"allow less to be missing"
        )


def _resolution(model: Model, options: OnlineOptions) -> np.ndarray:
    given = options.encoder_resolution
    if given is None:
        chain = load(packaged("crane_model", "sensors.yaml"), SensorChain)
        if unknown := set(model.joints) - set(JOINTS):
            raise ConfigurationError(
                f"encoder resolution of {', '.join(sorted(unknown))} is not known; give one count "
                f"of each encoder of {', '.join(model.joints)} [rad or m]"
            )
        return np.array([chain.encoder_resolution[joint] for joint in model.joints])
    if len(given) != len(model.joints) or not all(np.isfinite(r) and r > 0 for r in given):
        raise ConfigurationError(
            f"encoder resolution: one positive value each for {', '.join(model.joints)} needed, "
            f"got {list(given)}"
        )
    return np.array(given)
