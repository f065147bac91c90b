"""Hidden faults of encoders: turned, off their centres, ill divided."""

import numpy as np

from crane_sim.effects.form import SensorFault


class Turned(SensorFault):
    """An encoder that was mounted a little turned."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Only that column."""
        shown = q.copy()
        (offset,) = self.values
        shown[..., self.column] += offset
        return shown


class Strained(SensorFault):
    """An encoder whose coupling was mounted turned and a little bent."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """The offset swells and shrinks once a turn."""
        shown = q.copy()
        offset, share, phase = self.values
        shown[..., self.column] += offset * (1.0 + share * np.sin(q[..., self.column] + phase))
        return shown


class Slipped(SensorFault):
    """An encoder that was mounted turned, on a wheel of not quite the right size."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """The offset grows along the way."""
        shown = q.copy()
        offset, share = self.values
        shown[..., self.column] += offset * (1.0 + share * q[..., self.column])
        return shown


class Eccentric(SensorFault):
    """An encoder disk off its centre: an error that follows the sine of the angle."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Only that column."""
        shown = q.copy()
        error, turns, phase = self.values
        shown[..., self.column] += error * np.sin(turns * q[..., self.column] + phase)
        return shown


class TwoLobes(SensorFault):
    """A disk off its centre and not round."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """With a second harmonic."""
        shown = q.copy()
        error, turns, phase, second = self.values
        angle = turns * q[..., self.column] + phase
        shown[..., self.column] += error * (np.sin(angle) + second * np.sin(2.0 * angle))
        return shown


class Graduation(SensorFault):
    """A disk whose lines were divided with an error that builds up and jumps back."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """A rounded sawtooth."""
        shown = q.copy()
        error, turns, phase = self.values
        angle = turns * q[..., self.column] + phase
        shown[..., self.column] += error * np.arctan2(np.sin(angle), 1.5 + np.cos(angle))
        return shown
