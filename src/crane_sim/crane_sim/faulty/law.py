"""What becomes of the signal of a part that fails: one value after another, from the onset on."""

from abc import ABC, abstractmethod

import numpy as np
from typing_extensions import override


class FaultLaw(ABC):
    """A law with one parameter, `size`; `since` [s] is the time since the fault began."""

    def __init__(self, size: float, rng: np.random.Generator):
        self.size, self.rng = size, rng

    @abstractmethod
    def shown(self, since: float, value: float) -> float:
        """What comes of `value`; called in the order of time."""


class StuckLaw(FaultLaw):
    """The first value stays."""

    _held: float | None = None

    @override
    def shown(self, since: float, value: float) -> float:
        if self._held is None:
            self._held = value
        return self._held


class OffsetLaw(FaultLaw):
    """`size` more."""

    @override
    def shown(self, since: float, value: float) -> float:
        return value + self.size


class DriftLaw(FaultLaw):
    """`size` more with each second."""

    @override
    def shown(self, since: float, value: float) -> float:
        return value + self.size * since


class GainLaw(FaultLaw):
    """1 + `size` times the value."""

    @override
    def shown(self, since: float, value: float) -> float:
        return (1.0 + self.size) * value


class ScaleLaw(FaultLaw):
    """1 + `size` times the way from where it stood: an encoder that counts too much."""

    _stood: float | None = None

    @override
    def shown(self, since: float, value: float) -> float:
        if self._stood is None:
            self._stood = value
        return value + self.size * (value - self._stood)


class LostCountsLaw(FaultLaw):
    """Of every way up, the share `size` is not counted; what is lost stays lost."""

    _last: float | None = None
    _lost = 0.0

    @override
    def shown(self, since: float, value: float) -> float:
        if self._last is not None:
            self._lost += self.size * max(value - self._last, 0.0)
        self._last = value
        return value - self._lost


class NoiseLaw(FaultLaw):
    """Normal noise of standard deviation `size`."""

    @override
    def shown(self, since: float, value: float) -> float:
        return value + self.size * float(self.rng.standard_normal())


class BacklashLaw(FaultLaw):
    """What shows it hangs in a play of width `size`, and is taken along at its ends."""

    _follower: float | None = None

    @override
    def shown(self, since: float, value: float) -> float:
        half = 0.5 * self.size
        if self._follower is None:
            self._follower = value
        self._follower = min(max(self._follower, value - half), value + half)
        return self._follower


class SlowLaw(FaultLaw):
    """A first-order lag of time constant `size` [s], settled when it begins."""

    _state: float | None = None
    _last = 0.0

    @override
    def shown(self, since: float, value: float) -> float:
        if self._state is None:
            self._state = value
        decay = np.exp(-(since - self._last) / self.size)
        self._state, self._last = value + (self._state - value) * float(decay), since
        return self._state
