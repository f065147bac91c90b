"""The balance of flow of a joint as rows: what its piston sweeps, and what its parts supply.

    A_A x' =  Q_A - C (p_A - p_B) - (V_0A + A_A (x - x_min))/beta p_A'
   -A_B x' =  Q_B + C (p_A - p_B) - (V_0B + A_B (x_max - x))/beta p_B'

with the parts of `crane_model.hydraulics`. Every column is the central difference of its integral
over time, so that none is differentiated by itself, and passes the same low-pass as the left side;
a second one of first order makes the noise white again, most of which is that of differences.
Reversals are rows like others. It is linear in the gains of the four metering edges, C,
1/beta, V_0A/beta and V_0B/beta.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import signal

from crane_identification.hydraulics.passage import Passage
from crane_model.actuators import HydraulicActuator
from crane_model.hydraulics.chambers import roots
from crane_model.hydraulics.spool import openings, spool_course, trailing

CUT_OFF = 4.0  # Hz: what the machine moves at lies below, most of the noise above
ORDER = 4
WHITENED = 0.5  # Hz, above which differences of white noise are made white again
ROW_RATE = 16.0  # Hz of rows, where the filter has left next to nothing above half of that
SPOILT = 0.5  # s at both ends of a passage that the filter's memory spoils
FINE = 5  # steps of the spool a sample
LEAST_PRESSURE = 1e5  # Pa above the tank's; a chamber below is about to be empty and draws oil
DAMPING_RATIO = 0.8  # of the spool; from slow motion only (2 D^2 - 1)/w^2 can be told
FASTEST = 1e-4  # s, 1/w of a spool that cannot be told from an immediate one
EDGES = ("supply_a", "a_tank", "supply_b", "b_tank")
LINEAR = (*EDGES, "leakage", "compliance", "softness_a", "softness_b")
"""Names of the columns: compliance 1/beta, softness V_0/beta of each chamber."""


class SpoolValues(NamedTuple):
    """What the balance is not linear in; `share` is that part of the lag which is not delay."""

    lag: float  # s
    share: float
    dead_zone_a: float
    dead_zone_b: float
    play: float

    @property
    def frequency(self) -> float:
        """w [rad/s]."""
        return 1.0 / max(self.share * self.lag / (2.0 * DAMPING_RATIO), FASTEST)

    @property
    def delay(self) -> float:
        """From a command's stamp until the spool is told [s]."""
        return (1.0 - self.share) * self.lag


class PassageRows:
    """Rows of one passage.

    `rounding` (2,) [m3/s] is what the rounding of the encoder adds to them: one standard deviation,
    with the sign in which the two chambers share it.
    """

    def __init__(self, passage: Passage, cylinder: HydraulicActuator) -> None:
        self.passage = passage
        step = passage.step
        self._sections = signal.butter(ORDER, CUT_OFF, fs=1.0 / step, output="sos")
        self._integrating = signal.butter(1, WHITENED, fs=1.0 / step, output="sos")
        cut = int(SPOILT / step)
        self._kept = slice(cut, len(passage) - 2 - cut)
        self._every = max(int(1.0 / (ROW_RATE * step)), 1)
        p_a, p_b = passage.pressure_a, passage.pressure_b
        supply, tank = passage.supply_pressure, passage.tank_pressure
        filled = (np.minimum(p_a, p_b) > tank + LEAST_PRESSURE).astype(float)
        self._gate = signal.sosfiltfilt(self._sections, filled).clip(0.0, 1.0)[1:-1] * filled[1:-1]
        x, inner = passage.length, slice(1, -1)
        swept_a = cylinder.area_a * (x[inner] - cylinder.length_min)
        swept_b = cylinder.area_b * (cylinder.length_max - x[inner])
        speed, rate_a, rate_b = ((v[2:] - v[:-2]) / (2.0 * step) for v in (x, p_a, p_b))
        drop = p_a - p_b
        drop = (drop[:-2] + 2.0 * drop[inner] + drop[2:]) / 4.0
        none = np.zeros_like(drop)
        areas = np.array([cylinder.area_a, -cylinder.area_b])
        flow = np.outer(speed, areas)
        oil = (
            (-drop, drop),
            (-swept_a * rate_a, -swept_b * rate_b),
            (-rate_a, none),
            (none, -rate_b),
        )
        self.flow = self._filtered(flow)  # (n, 2)
        rounded = passage.resolution / np.sqrt(12.0)
        self.rounding = areas * rounded * _slope_gain(self._sections, self._integrating, step)
        self.oil = self._filtered(np.stack([np.stack(pair, axis=1) for pair in oil], axis=2))
        drops = (supply - p_a, p_a - tank, supply - p_b, p_b - tank)
        self._roots = np.stack([roots(one) for one in drops], axis=1)
        fine = FINE * (len(passage) - 1) + 1
        self._fine = passage.time[0] + step / FINE * np.arange(fine)

    def opening(self, spool: SpoolValues) -> np.ndarray:
        """(FINE (n - 1) + 1,) o of `crane_model.hydraulics.spool`, FINE a sample."""
        stamps, commands = self.passage.stamps + spool.delay, self.passage.commands
        y = spool_course(stamps, commands, self._fine, spool.frequency, DAMPING_RATIO)
        return openings(trailing(y, spool.play), spool.dead_zone_a, spool.dead_zone_b)

    def columns(self, spool: SpoolValues) -> np.ndarray:
        """(n, 2, 8) of LINEAR for 1 of each, before rows are thinned."""
        flows = _mean_flows(self.opening(spool), self._roots)
        edges = self._filtered(flows)
        out = np.zeros((len(edges), 2, len(LINEAR)))
        out[:, 0, :2], out[:, 1, 2:4] = edges[:, :2], edges[:, 2:]
        out[:, :, 4:] = self.oil
        return out

    def supply(self) -> np.ndarray:
        """(n, 2) 1 and the supply pressure [Pa], filtered like the flow."""
        pressure = self.passage.supply_pressure
        mean = (pressure[:-2] + 2.0 * pressure[1:-1] + pressure[2:]) / 4.0
        return self._filtered(np.stack([np.ones_like(mean), mean], axis=1))

    def drawn(self, spool: SpoolValues, linear: np.ndarray) -> np.ndarray:
        """(n,) flow out of the supply [m3/s], filtered like the flow."""
        columns = self.columns(spool)
        found: np.ndarray = columns[:, 0, 0] * linear[0] + columns[:, 1, 2] * linear[2]
        return found

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


class Balance:
    """Rows (N,) of all passages of a joint, of both chambers side by side."""

    def __init__(self, parts: Sequence[Passage], cylinder: HydraulicActuator) -> None:
        self.rows = [PassageRows(part, cylinder) for part in parts]

    @cached_property
    def flow(self) -> np.ndarray:
        """(N, 2) A_A x' and -A_B x' [m3/s]."""
        return np.concatenate([rows.thinned(rows.flow) for rows in self.rows])

    def columns(self, spool: SpoolValues) -> np.ndarray:
        """(N, 2, 8) of LINEAR."""
        return np.concatenate([rows.thinned(rows.columns(spool)) for rows in self.rows])

    def blocks(self, duration: float) -> np.ndarray:
        """(N,) number of the block, `duration` [s] long, that a row belongs to."""
        numbers: list[np.ndarray] = []
        for rows in self.rows:
            time = rows.thinned(rows.time)
            first = numbers[-1][-1] + 1 if numbers else 0
            numbers.append(first + ((time - time[0]) / duration).astype(int))
        return np.concatenate(numbers)


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


def _slope_gain(low: np.ndarray, integrating: np.ndarray, step: float) -> float:
    """Standard deviation of the filtered slope per unit standard deviation of white noise [1/s]."""
    angle, response = signal.sosfreqz(low, worN=4096)
    _, once = signal.sosfreqz(integrating, worN=4096)
    gain = np.abs(response) ** 2 * np.abs(once) * np.sin(angle) / step
    return float(np.sqrt(np.mean(gain**2)))
