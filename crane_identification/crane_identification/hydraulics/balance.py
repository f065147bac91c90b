"""The balance of flow of a joint as rows: what its piston sweeps, and what its parts supply.

    A_A x' =  Q_A - C (p_A - p_B) - (V_0A + A_A (x - x_min))/beta p_A'
   -A_B x' =  Q_B + C (p_A - p_B) - (V_0B + A_B (x_max - x))/beta p_B'

with the parts of `crane_model.hydraulics`. Every column is the central difference of its integral
over time, so that none is differentiated by itself, and passes the same low-pass as the left side;
a second one of first order makes the noise white again, most of which is that of differences.
Reversals are rows like others. It is linear in the gains of the four metering edges, C,
1/beta, V_0A/beta and V_0B/beta.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numba import njit
from scipy import signal
from scipy.interpolate import CubicSpline

from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import LARGEST_GAP, sampling_rate
from crane_identification.signals.motion import encoder_resolution
from crane_model.actuators import HydraulicActuator
from crane_model.cylinders import cylinder_length, lever_arm
from crane_model.errors import DataError
from crane_model.flow import EDGES
from crane_model.hydraulics.stepping import openings, roots, spool_course, trailing
from crane_model.machine import Machine

LEAST_FLOW_RUN_S = 3.0  # s; of what is shorter, the filter sees little but its ends
LEAST_FLOW_TIME_S = 8.0  # s of motion in either direction
STILL = 0.02  # of the fastest piston speed; below it a joint counts as at rest
FLOW_PRESSURES = ("pressure_a", "pressure_b", "supply_pressure", "tank_pressure")
METERING_DROP = "metering_drop"
"""Drop at all edges of a passage that feed, if valves share the flow of one pump [Pa]."""
COMMON = ("supply_pressure", "tank_pressure")  # of all joints; nominal where they are not logged
APART = {"position": "slew_position", "command": "slew_command"}  # in a log without this joint
VALVE_MOTION = tuple(APART)
FLOW_SIGNALS = (*VALVE_MOTION, *FLOW_PRESSURES)
CUT_OFF = 4.0  # Hz: what the machine moves at lies below, most of the noise above
FLOW_FILTER_ORDER = 4
WHITENED = 0.5  # Hz, above which differences of white noise are made white again
ROW_RATE = 16.0  # Hz of rows, where the filter has left next to nothing above half of that
SPOILT = 0.5  # s at both ends of a passage that the filter's memory spoils
FINE = 5  # steps of the spool a sample
LEAST_PRESSURE = 1e5  # Pa above the tank's; a chamber below is about to be empty and draws oil
FAINT_DROP = 3e5  # Pa of a shared pump at its limit, that transducers hardly tell from none
DAMPING_RATIO = 0.8  # of the spool; from slow motion only (2 D^2 - 1)/w^2 can be told
FASTEST = 1e-4  # s, 1/w of a spool that cannot be told from an immediate one
LINEAR = (*EDGES, "leakage", "compliance", "softness_a", "softness_b")
"""Names of the columns: compliance 1/beta, softness V_0/beta of each chamber."""


def between_counts(time: np.ndarray, reading: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Positions (m,) at the times `at` (m,), in counts, from readings (n,) of counts at `time`.

    While a joint creeps its reading stands, and then changes by a whole count, which is no motion
    of a whole count: when it changes, the joint is halfway. So these crossings are joined by lines,
    with the readings that differ from those before and behind.
    """
    stands = np.abs(np.diff(reading)) < 0.5
    beside = np.pad(stands, 1)  # (n + 1,) before and behind each reading
    lone = ~(beside[:-1] | beside[1:])
    lone[[0, -1]] = True
    crossing = ~stands & (beside[:-2] | beside[2:])
    times = np.concatenate([time[lone], 0.5 * (time[:-1] + time[1:])[crossing]])
    places = np.concatenate([reading[lone], 0.5 * (reading[:-1] + reading[1:])[crossing]])
    order = np.argsort(times)
    return np.interp(at, times[order], places[order])


@dataclass(frozen=True)
class Passage:
    """n samples, `step` [s] apart and without a gap; commands (m,) with stamps of their own.

    `length` of the cylinder [m], as `counts` of the encoder tell it, each of which is `resolution`;
    pressures [Pa]; commands are those of the spool, positive where they let oil into chamber A, and
    reach back to the start of the recording.
    """

    source: str
    step: float
    time: np.ndarray  # (n,) s
    length: np.ndarray  # (n,) m
    counts: np.ndarray  # (n,)
    resolution: np.ndarray  # (n,) m
    pressures: Mapping[str, np.ndarray]  # (n,) Pa each, by their names in a log
    stamps: np.ndarray  # (m,) s
    commands: np.ndarray  # (m,) -1..1

    def __len__(self) -> int:
        return len(self.time)


def passages(machine: Machine, joint: str, logs: Sequence[Log]) -> list[Passage]:
    """All parts of the recordings in which everything is known; of a joint without transducers,
    position and command, and supply and tank pressure where they are logged.

    `DataError` says what was not logged, or that the joint moves too little where all is known.
    """
    where = f"hydraulics of '{joint}'"
    wanted = FLOW_SIGNALS if machine.cylinders[joint].pressure_sensors else VALVE_MOTION
    if coupled := sorted(machine.seen_by(joint).keys() - {joint}):
        raise DataError(
            f"{where}: its actuator moves with {', '.join(coupled)} as well; valves are identified "
            "of actuators that move one joint"
        )
    lacking = {log.source: _lacking(log, joint, wanted) for log in logs}
    if logs and all(lacking.values()):
        log = logs[0]
        raise DataError(
            f"{where}: {log.source} holds no {', '.join(lacking[log.source])}; record valve "
            "commands, positions, and the pressures of supply, tank and chambers"
        )
    found = [
        part
        for log in logs
        if not lacking[log.source]
        for part in _parts(machine, joint, log, wanted)
    ]
    _require_motion(where, wanted, found, sum(float(np.ptp(log.position.time)) for log in logs))
    return found


def _lacking(log: Log, joint: str, wanted: Sequence[str]) -> list[str]:
    return [name for name in wanted if _column(log, joint, name) is None]


def _column(log: Log, joint: str, name: str) -> Signal | None:
    """The samples of a signal that hold a number for the joint, (k,); None if there are not two."""
    signal: Signal | None = getattr(log, name if joint in log.joints else APART.get(name, name))
    if signal is None:
        return None
    j = log.joints.index(joint) if signal.value.ndim == 2 else 0
    value = signal.value if signal.value.ndim == 1 else signal.value[:, j]
    known = np.isfinite(value)
    if np.count_nonzero(known) < 2:
        return None
    return Signal(signal.seen(j)[known], value[known], signal.origin)


def _parts(machine: Machine, joint: str, log: Log, wanted: Sequence[str]) -> list[Passage]:
    signals = {name: _column(log, joint, name) for name in (*wanted, *COMMON)}
    given = {name: signal for name, signal in signals.items() if signal is not None}
    step = 1.0 / sampling_rate(given["position"].time)
    begin = max(signal.time[0] for signal in given.values())
    end = min(signal.time[-1] for signal in given.values())
    time = begin + step * np.arange(max(int((end - begin) / step), 0))
    known = np.ones(len(time), dtype=bool)
    for measured in given.values():
        known &= _between_samples(measured.time, time)
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2)
    position, command = given["position"], given["command"]
    sense = float(np.sign(lever_arm(machine, joint, position.value).mean()))
    count = float(encoder_resolution(position.value[:, np.newaxis])[0]) or 1.0  # where it rests
    length = Signal(position.time, cylinder_length(machine, joint, position.value), position.origin)
    nominal = machine.hydraulics.model_dump(include=set(COMMON))
    times = [time[first:last] for first, last in edges if (last - first) * step >= LEAST_FLOW_RUN_S]
    return [
        Passage(
            source=log.source,
            step=step,
            time=inside,
            length=_smooth(length, inside),
            counts=between_counts(position.time, position.value / count, inside),
            resolution=count * np.abs(lever_arm(machine, joint, _smooth(position, inside))),
            pressures={name: np.full(len(inside), value) for name, value in nominal.items()}
            | {name: _smooth(given[name], inside) for name in given if name in FLOW_PRESSURES},
            stamps=command.time,
            commands=sense * command.value,
        )
        for inside in times
    ]


def _between_samples(stamps: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(n,) whether times lie between two stamps that are close enough to tell what was between."""
    longest = max(LARGEST_GAP, 2.0 * float(np.median(np.diff(stamps))))
    after = np.searchsorted(stamps, time).clip(1, len(stamps) - 1)
    return np.asarray(stamps[after] - stamps[after - 1] <= longest)


def _smooth(signal: Signal, time: np.ndarray) -> np.ndarray:
    """At the times (n,), by the cubic spline through the samples at their own stamps."""
    near = slice(
        max(int(np.searchsorted(signal.time, time[0])) - 4, 0),
        int(np.searchsorted(signal.time, time[-1])) + 4,
    )
    return np.asarray(CubicSpline(signal.time[near], signal.value[near])(time))


def _require_motion(
    where: str, wanted: Sequence[str], found: Sequence[Passage], recorded: float
) -> None:
    speeds = [np.gradient(part.length, part.step) for part in found]
    fastest = max((float(np.abs(speed).max()) for speed in speeds), default=0.0)
    out, back = (
        sum(
            float((sign * speed > STILL * fastest).sum()) * part.step
            for part, speed in zip(found, speeds, strict=True)
        )
        for sign in (1.0, -1.0)
    )
    if min(out, back) < LEAST_FLOW_TIME_S:
        known = sum(len(part) * part.step for part in found)
        raise DataError(
            f"{where}: its cylinder extends for {out:.0f} s and retracts for {back:.0f} s with "
            f"all signals known, {LEAST_FLOW_TIME_S:.0f} s each needed; "
            + (
                f"{', '.join(wanted)} are known together for {known:.1f} s of {recorded:.1f} s: "
                "log them all along"
                if known < 0.9 * recorded
                else "record longer, or move it more"
            )
        )


class SpoolValues(NamedTuple):
    """Nonlinear parameters of the balance; `share` is that part of the lag which is not delay."""

    lag: float  # s
    share: float
    dead_band_a: float
    dead_band_b: float
    play: float

    @property
    def frequency(self) -> float:
        """Natural frequency w of the spool [rad/s]."""
        return 1.0 / max(self.share * self.lag / (2.0 * DAMPING_RATIO), FASTEST)

    @property
    def delay(self) -> float:
        """From a command's stamp until the spool is told [s]."""
        return (1.0 - self.share) * self.lag


class PassageRows:
    """Common data of the rows of one passage: the opening of the valve, and the filter."""

    def __init__(self, passage: Passage, gate: np.ndarray | None = None) -> None:
        """`gate` (n,) is 1 where the samples count, 0 where not."""
        self.passage = passage
        step = passage.step
        self._sections = signal.butter(FLOW_FILTER_ORDER, CUT_OFF, fs=1.0 / step, output="sos")
        self._integrating = signal.butter(1, WHITENED, fs=1.0 / step, output="sos")
        cut = int(SPOILT / step)
        self._kept = slice(cut, len(passage) - 2 - cut)
        self._every = max(int(1.0 / (ROW_RATE * step)), 1)
        open_ = np.ones(len(passage)) if gate is None else gate
        self._gate = signal.sosfiltfilt(self._sections, open_).clip(0.0, 1.0)[1:-1] * open_[1:-1]
        fine = FINE * (len(passage) - 1) + 1
        self._fine = passage.time[0] + step / FINE * np.arange(fine)

    def opening(self, spool: SpoolValues) -> np.ndarray:
        """(FINE (n - 1) + 1,) o of `crane_model.hydraulics.stepping`, FINE a sample."""
        stamps, commands = self.passage.stamps + spool.delay, self.passage.commands
        y = spool_course(stamps, commands, self._fine, spool.frequency, DAMPING_RATIO)
        return openings(trailing(y, spool.play), spool.dead_band_a, spool.dead_band_b)

    def flows(self, spool: SpoolValues, drops: np.ndarray) -> np.ndarray:
        """(n, 4) filtered flow through EDGES for a gain of 1, from roots of their drops."""
        return self._filtered(_mean_flows(self.opening(spool), drops))

    @property
    def speed(self) -> np.ndarray:
        """(n,) m/s of the piston, filtered."""
        return self._filtered(self._slope(self.passage.length))

    def speed_rounding(self, shift: float) -> np.ndarray:
        """(n,) m/s, filtered: what the encoder would round of this motion were it to stand by a
        `shift` of its counts elsewhere. Where the joint creeps or rests, that is no white noise.
        """
        smooth = signal.sosfiltfilt(self._sections, self.passage.counts) + shift
        return self._filtered(self._slope(self.passage.resolution * (np.round(smooth) - smooth)))

    def _slope(self, values: np.ndarray) -> np.ndarray:
        slope: np.ndarray = (values[2:] - values[:-2]) / (2.0 * self.passage.step)
        return slope

    def thinned(self, values: np.ndarray) -> np.ndarray:
        """As many of n samples as the filter left independent."""
        return values[:: self._every]

    @property
    def time(self) -> np.ndarray:
        """(n,) s of the samples, before they are thinned."""
        return self.passage.time[1:-1][self._kept]

    def _filtered(self, values: np.ndarray) -> np.ndarray:
        gate = self._gate.reshape(-1, *[1] * (values.ndim - 1))
        low = signal.sosfiltfilt(self._sections, values * gate, axis=0)[self._kept]
        return np.asarray(signal.sosfilt(self._integrating, low, axis=0))


class ChamberRows(PassageRows):
    """Rows of both chambers."""

    def __init__(self, passage: Passage, cylinder: HydraulicActuator) -> None:
        p_a, p_b, supply, tank = (
            passage.pressures[name]
            for name in ("pressure_a", "pressure_b", "supply_pressure", "tank_pressure")
        )
        counted = np.minimum(p_a, p_b) > tank + LEAST_PRESSURE
        feeding = passage.pressures.get(METERING_DROP)
        if feeding is not None:
            counted &= feeding > FAINT_DROP
        super().__init__(passage, counted.astype(float))
        self._areas = np.array([cylinder.area_a, -cylinder.area_b])
        self.flow = np.outer(self.speed, self._areas)  # (n, 2)
        swept_a, swept_b = cylinder.chambers.swept(passage.length[1:-1])
        rate_a, rate_b, drop = self._slope(p_a), self._slope(p_b), _mean(p_a - p_b)
        none = np.zeros_like(drop)
        oil = (
            (-drop, drop),
            (-swept_a * rate_a, -swept_b * rate_b),
            (-rate_a, none),
            (none, -rate_b),
        )
        self.oil = self._filtered(np.stack([np.stack(pair, axis=1) for pair in oil], axis=2))
        over_a, over_b = supply - p_a, supply - p_b
        if feeding is not None:  # a chamber that is fed is at most the highest load
            over_a, over_b = (np.clip(over, 0.0, feeding) for over in (over_a, over_b))
        drops = (over_a, p_a - tank, over_b, p_b - tank)
        self._roots = np.stack([roots(drop) for drop in drops], axis=1)

    def columns(self, spool: SpoolValues) -> np.ndarray:
        """(n, 2, 8) of LINEAR for 1 of each, before rows are thinned."""
        edges = self.flows(spool, self._roots)
        out = np.zeros((len(edges), 2, len(LINEAR)))
        out[:, 0, :2], out[:, 1, 2:4] = edges[:, :2], edges[:, 2:]
        out[:, :, 4:] = self.oil
        return out

    def rounding(self, shift: float) -> np.ndarray:
        """(n, 2) m3/s: what rounding adds to the flow, as `speed_rounding`."""
        return np.outer(self.speed_rounding(shift), self._areas)

    def supply(self) -> np.ndarray:
        """(n, 2) 1 and the supply pressure [Pa], filtered like the flow."""
        mean = _mean(self.passage.pressures["supply_pressure"])
        return self._filtered(np.stack([np.ones_like(mean), mean], axis=1))

    def drawn(self, spool: SpoolValues, linear: np.ndarray) -> np.ndarray:
        """(n,) flow out of the supply [m3/s], filtered like the flow."""
        edges = self.flows(spool, self._roots)
        a, b = EDGES.index("supply_a"), EDGES.index("supply_b")
        drawn: np.ndarray = edges[:, a] * linear[a] + edges[:, b] * linear[b]
        return drawn


class MotionRows(PassageRows):
    """Rows of a joint without transducers: its speed, from the flow at no load.

        x' = K+ o sqrt((A_A p_S - A_B p_T) / (A_A^3 + A_B^3))   where o > 0,
        x' = K- o sqrt((A_B p_S - A_A p_T) / (A_A^3 + A_B^3))   where o < 0

    of two equal edges in series, each passing what its chamber takes.
    """

    def __init__(self, passage: Passage, cylinder: HydraulicActuator) -> None:
        super().__init__(passage)
        self.flow = self.speed[:, np.newaxis]
        supply, tank = (passage.pressures[name] for name in ("supply_pressure", "tank_pressure"))
        a, b = cylinder.area_a, cylinder.area_b
        out, back = (
            roots(drop / (a**3 + b**3)) for drop in (a * supply - b * tank, b * supply - a * tank)
        )
        self._roots = np.stack([out, back, back, out], axis=1)

    def columns(self, spool: SpoolValues) -> np.ndarray:
        """(n, 1, 2) of K+ and K- for 1 of each."""
        return self.flows(spool, self._roots)[:, np.newaxis, :2]


AnyRows = TypeVar("AnyRows", ChamberRows, MotionRows)


class Balance(Generic[AnyRows]):
    """Rows (N,) of all passages of a joint, its c flows (both chambers, or the speed) beside."""

    def __init__(self, rows: Sequence[AnyRows]) -> None:
        self.rows: Sequence[AnyRows] = rows

    @cached_property
    def flow(self) -> np.ndarray:
        """(N, c) flows into the chambers [m3/s], or the speed of the piston [m/s]."""
        return np.concatenate([rows.thinned(rows.flow) for rows in self.rows])

    def columns(self, spool: SpoolValues) -> np.ndarray:
        """(N, c, k) of the linear parameters."""
        return np.concatenate([rows.thinned(rows.columns(spool)) for rows in self.rows])

    def blocks(self, duration: float) -> np.ndarray:
        """(N,) number of the block, `duration` [s] long, that a row belongs to."""
        numbers: list[np.ndarray] = []
        for rows in self.rows:
            time = rows.thinned(rows.time)
            first = numbers[-1][-1] + 1 if numbers else 0
            numbers.append(first + ((time - time[0]) / duration).astype(int))
        return np.concatenate(numbers)


def _mean(values: np.ndarray) -> np.ndarray:
    """(n - 2,) over the samples before and behind, of (n,)."""
    mean: np.ndarray = (values[:-2] + 2.0 * values[1:-1] + values[2:]) / 4.0
    return mean


@njit(cache=True, error_model="numpy")
def _mean_flows(o: np.ndarray, roots: np.ndarray) -> np.ndarray:
    """(n - 2, 4) flow through EDGES for a gain of 1, mean of the samples before and behind.

    From openings (FINE (n - 1) + 1,) and roots of the drops (n, 4), linear between samples.
    """
    count = len(roots) - 1
    mean = np.zeros((count, 4))
    for k in range(count):
        for i in range(FINE + 1):
            share = i / FINE
            weight = (0.5 if i in (0, FINE) else 1.0) / FINE
            opened = o[FINE * k + i]
            for first, second, sign in ((0, 3, 1.0), (2, 1, -1.0)):
                if sign * opened > 0.0:
                    used = weight * sign * opened
                    for edge, into in ((first, 1.0), (second, -1.0)):
                        root = roots[k, edge] * (1.0 - share) + roots[k + 1, edge] * share
                        mean[k, edge] += into * used * root
    return 0.5 * (mean[1:] + mean[:-1])
