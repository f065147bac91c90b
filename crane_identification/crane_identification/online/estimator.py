"""Online identification without ROS: readings go in, estimates and forces come out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_bags.clocks import NANOSECONDS
from crane_identification.online.recursion import Recursion, ResidualCorrelation, Solution
from crane_identification.online.streams import FixedLagSmoother, Matched, Matcher, Smoothed
from crane_identification.preparation.run import STANDSTILL_SIGMAS
from crane_model.configuration import load
from crane_model.cylinders import ChamberForces
from crane_model.errors import ConfigurationError, DataError, RangeError
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.sensors import SensorChain
from crane_observer.recording import AlignedEncoders

# Rows of (28) from the instants of the smoother: both sides averaged over the same window.
#
# Φ is nonlinear in the motion, so that smoothing the motion and evaluating Φ do not commute: where
# the crane swings on its oil at 2 to 3 Hz, Φ of a motion that was smoothed over 0.4 s is off by
# some per cent of the swinging part, always the same way. So the smoother is narrow, Φ is evaluated
# at each of its instants, and what remains to be smoothed is smoothed here, Φ and τ alike
# ("parallel filtering"): a linear filter on both sides of (28) leaves Θ as it is.

Sides = Callable[[list[Smoothed]], np.ndarray]
"""Both sides of (28) at n instants: (n, j, p + 1), the columns of Φ and then τ."""
REFRESH = NANOSECONDS  # between two weightings of the joints for the prediction
INSTANTS = 4  # of the smoother for every row
SHARE = 0.25  # of the lag: half the window of the smoother
GAP_SHARE = 0.125  # of the lag: readings that the smoother needs


class Row(NamedTuple):
    """A row of each joint at `stamp` [ns] in the middle of its window, which begins at `begin`:
    `columns` (j, p) and `force` (j,), in stretch number `run`.
    """

    stamp: int
    begin: int
    run: int
    columns: np.ndarray
    force: np.ndarray


class Window:
    """A row every `every` instants of the smoother, `step` [ns] apart, on the grid of the clock.

    It averages `half` instants on either side of the row, weighted by cos² (Hann): what is faster
    than a row can show is gone, and acceleration noise with it.
    """

    def __init__(self, sides: Sides, half: int, every: int, step: int):
        self._sides, self._half, self._every, self._step = sides, half, every, step
        weights = np.hanning(2 * half + 3)[1:-1]
        self._weights = weights / weights.sum()
        self._waiting: list[Smoothed] = []
        self._known = np.empty((0, 0, 0))
        self._run = -1

    @property
    def overlap(self) -> float:
        """Spectral density at 0 Hz of white noise averaged over these windows, over its own."""
        return float(1.0 / (self._every * (self._weights**2).sum()))

    def add(self, smoothed: Smoothed) -> Row | None:
        """The row whose window the next instant completes, if it does."""
        if smoothed.run != self._run:
            self._run = smoothed.run
            self._waiting, self._known = [], np.empty((0, 0, 0))
        self._waiting.append(smoothed)
        middle = smoothed.stamp - self._half * self._step
        if middle % (self._every * self._step):
            return None
        found = self._sides(self._waiting)
        self._waiting = []
        if len(self._known):
            found = np.concatenate([self._known, found])
        self._known = found[-len(self._weights) :]
        if len(self._known) < len(self._weights):
            return None
        row = np.tensordot(self._weights, self._known, axes=1)
        begin = middle - self._half * self._step
        return Row(middle, begin, self._run, row[:, :-1], row[:, -1])


# The gate of the offline regression, as samples come: the sign of a velocity must be known.


class Gate:
    """Tells how long each joint has moved one way.

    As offline, speeds below 3 standard deviations of the velocity estimate count as standstill,
    where (13) is set-valued, and a row with standstill, a reversal or the begin of a run in its
    window is not used: the friction force of (13) jumps there, and the smoothed one does not.
    """

    def __init__(self, noise: np.ndarray):
        self._noise = noise  # (j,) standard deviation of a single reading
        self._direction = np.zeros(len(noise))
        self._since = np.zeros(len(noise), dtype=np.int64)  # ns, begin of this direction
        self._run = -1

    def add(self, smoothed: Smoothed) -> None:
        direction = np.sign(smoothed.velocity)
        direction[np.abs(smoothed.velocity) <= self.resolution(smoothed)] = 0.0
        turned = direction != self._direction
        if smoothed.run != self._run:
            self._run = smoothed.run
            turned[:] = True
        self._since[turned] = smoothed.stamp
        self._direction = direction

    def open(self, begin: int) -> np.ndarray:
        """Which joints (j,) moved one way at every velocity from `begin` [ns] on."""
        return (self._direction != 0.0) & (self._since <= begin)

    def resolution(self, smoothed: Smoothed) -> np.ndarray:
        """Speed (j,) below which the sign of this estimate is not known."""
        return STANDSTILL_SIGMAS * self._noise * smoothed.velocity_gain


@dataclass(frozen=True)
class OnlineOptions:
    """Choices of online identification; times in s.

    `lag` is half the window of a row (and four times that of the smoother), `period` the time from
    row to row (more of them tell nothing new: their windows overlap), `largest_gap` what may be
    missing before a new run begins, at most an eighth of the lag. `forgetting` is the factor λ per
    row: the memory is period/(1 - λ). `encoder_resolution` (j,) [rad or m] is one count of the
    encoder of each joint of the model; None: those in `sensors.yaml` of the
    `machine`.
    """

    lag: float = 0.2
    period: float = 0.05
    forgetting: float = 1.0
    largest_gap: float = 0.025
    encoder_resolution: tuple[float, ...] | None = None
    machine: str = DEFAULT_MACHINE


class Forces(NamedTuple):
    """Generalized forces (j,) [N m or N] of the row at `stamp` [ns].

    `predicted` is NaN while the parameters are not all determined; `used` (j,) says whose rows the
    estimate learned from.
    """

    stamp: int
    measured: np.ndarray
    predicted: np.ndarray
    used: np.ndarray


class OnlineEstimator:
    """Θ of a model from encoders and pressures (or forces), in any interleaving of the two streams.

    The standard deviations sum the autocorrelation of the residual of each joint (see
    `ResidualCorrelation`): averaged forces are correlated from row to row, and counting every row
    as independent would make them two to three times too narrow. Over twenty recordings they agree
    with the scatter of the estimates between recordings. What they do not cover is a bias from
    effects that the model lacks.
    """

    def __init__(
        self, model: Model, options: OnlineOptions | None = None, from_pressures: bool = True
    ):
        """`ConfigurationError` if the options do not fit the model, or it lacks a machine."""
        self.model = model
        self.options = options or OnlineOptions()
        if from_pressures and model.machine is None:
            raise ConfigurationError(
                f"model '{model.name}': has no machine, so that forces cannot be computed from "
                f"pressures (27); name one in the model file"
            )
        self._force = (
            ChamberForces(model.machine, model.joints) if from_pressures and model.machine else None
        )
        _check(self.options)
        self._noise = _resolution(model, self.options) / np.sqrt(12)
        self.reset()

    def reset(self) -> None:
        o, joints = self.options, len(self.model.joints)
        machine = self.model.machine
        latency = machine.latency(self.model.joints) if machine else np.zeros(joints)
        self._aligned = AlignedEncoders(latency * NANOSECONDS)
        self.matcher = Matcher(round(o.largest_gap * NANOSECONDS))
        step = round(o.period * NANOSECONDS / INSTANTS)
        half = round(o.lag * NANOSECONDS) // step
        self.smoother = FixedLagSmoother(joints, SHARE * o.lag, step / NANOSECONDS, o.largest_gap)
        self._gate = Gate(self._noise)
        self._window = Window(self._sides, half, INSTANTS, step)
        self._recursion = Recursion(joints, len(self.model.parameters), o.forgetting)
        shared = 2 * (half + half // INSTANTS) // INSTANTS  # rows that see a reading
        self._correlation = ResidualCorrelation(joints, 4 * shared, self._window.overlap)
        self._solution = self._recursion.solve()
        self._run = -1
        self.stamp = 0  # ns, of the newest row
        self.rows = 0  # used or not
        self.invalid = 0  # readings that are not finite or outside what the linkages can reach

    def add_position(self, stamp: int, position: np.ndarray) -> list[Forces]:
        """Encoder readings (j,) of the model's joints, stamped in ns; what they complete."""
        if not np.isfinite(position).all():
            self.invalid += 1
            return []
        time, position = self._aligned.at(stamp, position)
        return self._process(self.matcher.add_position(round(time), position))

    def add_pressure(
        self, stamp: int, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> list[Forces]:
        """Chamber pressures (j,) [Pa gauge] of the model's joints; what they complete."""
        pressure = np.concatenate([chamber_a, chamber_b])
        if not np.isfinite(pressure).all():
            self.invalid += 1
            return []
        return self._process(self.matcher.add_pressure(stamp, pressure))

    def add_force(self, stamp: int, force: np.ndarray) -> list[Forces]:
        """Generalized forces (j,) [N m or N] where they are measured; what they complete."""
        if not np.isfinite(force).all():
            self.invalid += 1
            return []
        return self._process(self.matcher.add_pressure(stamp, force))

    @property
    def samples(self) -> int:
        return self._recursion.samples

    @property
    def gated_share(self) -> float:
        """Share of the rows that were not used; NaN without any."""
        total = self.rows * len(self.model.joints)
        return 1.0 - self.samples / total if total else np.nan

    def solve(self) -> Solution:
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
        for stamp, position, driving in matched:
            try:
                carried = self._carried(position, driving)
            except RangeError:
                self.invalid += 1
                continue
            for smoothed in self.smoother.add(stamp, position, carried):
                self._gate.add(smoothed)
                row = self._window.add(smoothed)
                if row is not None:
                    out.append(self._learn(row, self._gate.open(row.begin)))
        return out

    def _carried(self, position: np.ndarray, driving: np.ndarray) -> np.ndarray:
        """Forces (j,), and behind them the pressures (2j,) where `driving` is those."""
        if self._force is None or len(driving) == len(position):
            return driving
        return np.concatenate([self._force(position, driving), driving])

    def _learn(self, row: Row, used: np.ndarray) -> Forces:
        """Predict the row with what is known, then learn from it."""
        predicted = np.full(len(used), np.nan)
        if row.run != self._run:
            self._run = row.run
            self._correlation.interrupt()
        if self._solution.determined.all():
            predicted = row.columns @ self._recursion.values(self._solution.weights)
            self._correlation.add(row.force - predicted, used)
        self._recursion.update(row.columns, row.force, used)
        if row.stamp // REFRESH != self.stamp // REFRESH:
            self._solution = self.solve()
        self.stamp = row.stamp
        self.rows += 1
        return Forces(row.stamp, row.force, predicted, used)

    def _sides(self, instants: list[Smoothed]) -> np.ndarray:
        """Both sides of (28) at these instants, (n, j, p + 1)."""
        joints = len(self.model.joints)
        carried = np.array([instant.carried for instant in instants])
        force, pressure_a, pressure_b = np.split(carried, [joints, 2 * joints], axis=1)
        pressures = carried.shape[1] > joints
        record = Record(
            joints=self.model.joints,
            time=np.array([instant.stamp / NANOSECONDS for instant in instants]),
            position=np.array([instant.position for instant in instants]),
            velocity=np.array([instant.velocity for instant in instants]),
            acceleration=np.array([instant.acceleration for instant in instants]),
            force=force,
            pressure_a=pressure_a if pressures else None,
            pressure_b=pressure_b if pressures else None,
            # the finest of them: what the gate lets through has a sign at every instant
            velocity_resolution=np.min(
                [self._gate.resolution(instant) for instant in instants], axis=0
            ),
        )
        return np.concatenate([self.model.regressor(record), force[:, :, np.newaxis]], axis=2)


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
        file = machine_file("sensors.yaml", options.machine)
        known = load(file, SensorChain).encoder_resolution
        if unknown := set(model.joints) - set(known):
            raise ConfigurationError(
                f"encoder resolution of {', '.join(sorted(unknown))} is not known, {file} has that "
                f"of {', '.join(known)}; name the machine, or give one count of each encoder of "
                f"{', '.join(model.joints)} [rad or m]"
            )
        return np.array([known[joint] for joint in model.joints])
    if len(given) != len(model.joints) or not all(np.isfinite(r) and r > 0 for r in given):
        raise ConfigurationError(
            f"encoder resolution: one positive value each for {', '.join(model.joints)} needed, "
            f"got {list(given)}"
        )
    return np.array(given)
