"""Hidden faults of what transducers show: pulsation, crosstalk, delays."""

import numpy as np
from numba import njit

from crane_sim.effects.form import SensorFault
from crane_sim.effects.transducers import ABOUT_PA, BOTH, BothTransducers


class Ripple(SensorFault):
    """The pump's pulsation in both chambers, aliased by the sampling, slowly beating."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """In chamber B weaker and later."""
        ripple, frequency = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        phase = 2.0 * np.pi * frequency * time
        beat = ripple * (1.0 + 0.3 * np.sin(0.9 * time))
        shown_a[:, self.column] += beat * np.sin(phase)
        shown_b[:, self.column] += 0.4 * beat * np.sin(phase - 1.0)
        return shown_a, shown_b


class WanderingRipple(SensorFault):
    """As of a pump whose speed wanders: the pulsation is nowhere for long."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """In chamber A."""
        ripple, frequency, wander = self.values
        shown = chamber_a.copy()
        phase = 2.0 * np.pi * frequency * (time + wander * np.sin(0.4 * time))
        shown[:, self.column] += ripple * np.sin(phase)
        return shown, chamber_b


class TwoRipples(SensorFault):
    """Two pumps, each with a line of its own, in both chambers."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """In chamber B against the sense of chamber A."""
        ripple, frequency, ratio = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        both = np.sin(2.0 * np.pi * frequency * time)
        both = ripple * (both + 0.6 * np.sin(2.0 * np.pi * ratio * frequency * time + 1.0))
        shown_a[:, self.column] += both
        shown_b[:, self.column] -= 0.3 * both
        return shown_a, shown_b


class Crosstalk(SensorFault):
    """A channel that picks up some of the next joint's."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Chamber B of the neighbour reaches the channel of chamber A."""
        share = self.values[0]
        following = self.measured.index(self.column) + 1
        source = self.measured[following % len(self.measured)]
        shown = chamber_a.copy()
        shown[:, self.column] += share * chamber_b[:, source]
        return shown, chamber_b


class CrosstalkOfA(Crosstalk):
    """A channel that picks up some of the like one of the next joint."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Chamber A of the neighbour reaches the channel of chamber A."""
        return super().pressures(time, chamber_a, chamber_a)[0], chamber_b


class SharedGround(Crosstalk):
    """Channels of which one lifts the other's ground, more than in proportion."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """By a power of the pressure in chamber B of the neighbour."""
        lifted = ABOUT_PA * (np.maximum(chamber_b, 0.0) / ABOUT_PA) ** self.values[1]
        return super().pressures(time, chamber_a, lifted)[0], chamber_b


class DelayedReadings(BothTransducers):
    """Pressures that are stamped late: those of a moment before are shown."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Straight lines between the samples."""
        (delay,) = self.values
        return np.interp(time - delay, time, pressure)


class LaggingReadings(BothTransducers):
    """A narrow line before the transducers: first order, with the same delay at low frequency."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """The pressure behind a first-order lag, settled at the first sample."""
        (lag,) = self.values
        return _lagging(time, np.ascontiguousarray(pressure), lag)


class AveragedReadings(BothTransducers):
    """Readings that are means over a time, stamped late: a share of the delay is half that time."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Of the straight lines between samples."""
        delay, share = self.values
        steps = np.diff(time)
        summed = np.append(0.0, np.cumsum((pressure[1:] + pressure[:-1]) / 2.0 * steps))
        end = np.maximum(time - (1.0 - share) * delay, time[0])
        begin = np.maximum(end - 2.0 * share * delay, time[0])
        over = end - begin
        mean = np.diff(np.interp(np.stack([begin, end]), time, summed), axis=0)[0]
        mean /= np.where(over > 0.0, over, 1.0)
        return np.where(over > 0.0, mean, pressure[0])


@njit(cache=True)
def _lagging(time: np.ndarray, true: np.ndarray, lag: float) -> np.ndarray:
    """Exact for a true signal that is straight between samples."""
    shown = true.copy()
    for k in range(1, len(true)):
        interval = time[k] - time[k - 1]
        slope = (true[k] - true[k - 1]) / interval
        behind = true[k - 1] - slope * lag  # where the answer to this straight line begins
        decay = np.exp(-interval / lag)
        shown[k] = behind + slope * interval + (shown[k - 1] - behind) * decay
    return shown
