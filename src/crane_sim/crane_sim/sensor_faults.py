"""Sensors and valves that fail while the crane works, and how a user writes their faults."""

import argparse
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_sim.effects.form import measured_joints

# Signals of a part that fails: one value after another, from the onset on.


class FaultLaw(ABC):
    """A law with one parameter, `size`; `since` [s] is the time since the fault began."""

    def __init__(self, size: float, rng: np.random.Generator):
        self.size, self.rng = size, rng

    @abstractmethod
    def shown(self, since: float, value: float) -> float:
        """Reading in place of `value`; called in the order of time."""


class StuckLaw(FaultLaw):
    """The first value stays."""

    _held: float | None = None

    def shown(self, since: float, value: float) -> float:
        if self._held is None:
            self._held = value
        return self._held


class OffsetLaw(FaultLaw):
    """`size` more."""

    def shown(self, since: float, value: float) -> float:
        return value + self.size


class DriftLaw(FaultLaw):
    """`size` more with each second."""

    def shown(self, since: float, value: float) -> float:
        return value + self.size * since


class GainLaw(FaultLaw):
    """1 + `size` times the value."""

    def shown(self, since: float, value: float) -> float:
        return (1.0 + self.size) * value


class ScaleLaw(FaultLaw):
    """1 + `size` times the way from where it stood: an encoder that counts too much."""

    _stood: float | None = None

    def shown(self, since: float, value: float) -> float:
        if self._stood is None:
            self._stood = value
        return value + self.size * (value - self._stood)


class LostCountsLaw(FaultLaw):
    """The share `size` of every upward motion is not counted, and stays lost."""

    _last: float | None = None
    _lost = 0.0

    def shown(self, since: float, value: float) -> float:
        if self._last is not None:
            self._lost += self.size * max(value - self._last, 0.0)
        self._last = value
        return value - self._lost


class NoiseLaw(FaultLaw):
    """Normal noise of standard deviation `size`."""

    def shown(self, since: float, value: float) -> float:
        return value + self.size * float(self.rng.standard_normal())


class BacklashLaw(FaultLaw):
    """The reading hangs in a play of width `size`, and is taken along at its ends."""

    _follower: float | None = None

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

    def shown(self, since: float, value: float) -> float:
        if self._state is None:
            self._state = value
        decay = np.exp(-(since - self._last) / self.size)
        self._state, self._last = value + (self._state - value) * float(decay), since
        return self._state


# The faults that a part of the simulated crane can have, and how a user writes them.

SUPPLY, ENCODER, VALVE_PART, BOTH_CHAMBERS = "supply", "encoder", "valve", "pressures"
CHAMBERS = "pressure_a", "pressure_b"
LEAKING, SWAPPED = "leaking", "swapped"


class KindOfFault(NamedTuple):
    """How it changes the signal of its part, if by a law, and how much unless a user says."""

    law: type[FaultLaw] | None
    size: float = 0.0  # 0: it has none
    lowest: float = -math.inf  # that makes sense


_TRANSDUCER = {
    "stuck": KindOfFault(StuckLaw),
    "offset": KindOfFault(OffsetLaw, 3e5),  # Pa
    "drift": KindOfFault(DriftLaw, 1e4),  # Pa/s
    "gain": KindOfFault(GainLaw, 0.1, -1.0),
    "noise": KindOfFault(NoiseLaw, 1e5, 0.0),  # Pa rms
}
KINDS: dict[str, dict[str, KindOfFault]] = {
    ENCODER: {
        "stuck": KindOfFault(StuckLaw),
        "jump": KindOfFault(OffsetLaw, 0.02),  # rad, m
        "drift": KindOfFault(DriftLaw, 1e-3),  # rad/s, m/s
        "lost_counts": KindOfFault(LostCountsLaw, 0.05, 0.0),
        "scale": KindOfFault(ScaleLaw, 0.05, -1.0),
        "noise": KindOfFault(NoiseLaw, 1e-3, 0.0),  # rad, m rms
        "backlash": KindOfFault(BacklashLaw, 5e-3, 0.0),  # rad, m
    },
    **dict.fromkeys(CHAMBERS, _TRANSDUCER),
    BOTH_CHAMBERS: {SWAPPED: KindOfFault(None)},
    "pressure": _TRANSDUCER,
    VALVE_PART: {
        "stuck": KindOfFault(StuckLaw),
        "slow": KindOfFault(SlowLaw, 0.3, 1e-3),  # s
        LEAKING: KindOfFault(None, 2e-12, 0.0),  # m3/(s Pa) past the piston
    },
}
"""Part, kind."""

SYNTAX = "write TARGET.PART.KIND, =SIZE and @SECONDS behind it if they are wanted"


class TimedFault(NamedTuple):
    """A part that fails at `onset` [s]; None: as soon as it can."""

    target: str  # a joint, or the supply
    part: str
    kind: str
    size: float
    onset: float | None = None

    @property
    def place(self) -> str:
        return f"{self.target}.{self.part}"

    def __str__(self) -> str:
        size = f"={self.size:g}" if KINDS[self.part][self.kind].size else ""
        begin = "" if self.onset is None else f"@{self.onset:g}"
        return f"{self.place}.{self.kind}{size}{begin}"


def parse(text: str, machine: Machine) -> TimedFault:
    """Parse a fault, `inner_boom.encoder.jump=0.02@12.5`; `ConfigurationError` gives the reason."""

    def refused(why: str) -> ConfigurationError:
        return ConfigurationError(f"fault '{text.strip()}': {why}")

    rest, at, begin = text.strip().partition("@")
    name, equal, amount = rest.partition("=")
    words = name.strip().split(".")
    if len(words) != 3:
        raise refused(SYNTAX)
    target, part, kind = words
    parts = parts_of(machine)
    if target not in parts:
        raise refused(f"there is no {target!r}; there are {', '.join(parts)}")
    if part not in parts[target]:
        raise refused(f"{target} has no {part!r}; it has {', '.join(parts[target])}")
    kinds = KINDS[part]
    if kind not in kinds:
        raise refused(f"{part} has no fault {kind!r}; there are {', '.join(kinds)}")
    usual, lowest = kinds[kind].size, kinds[kind].lowest
    if equal and not usual:
        raise refused(f"{kind} has no size; leave {equal}{amount} out")
    try:
        size = float(amount) if equal else usual
        onset = float(begin) if at else None
    except ValueError:
        raise refused(SYNTAX) from None
    if not (math.isfinite(size) and size >= lowest):
        raise refused(f"the size is {size:g}; it must be finite and at least {lowest:g}")
    if onset is not None and not (math.isfinite(onset) and onset >= 0.0):
        raise refused(f"it begins at {onset:g} s; it must be finite and not negative")
    return TimedFault(target, part, kind, size, onset)


def add_faults(parser: argparse.ArgumentParser) -> None:
    """`--fault`, once for each."""
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="TARGET.PART.KIND[=SIZE][@SECONDS]",
        help="fault of a sensor or valve, for example JOINT.encoder.stuck@12.5, at a "
        "time in seconds from the beginning; may be repeated. Parts of a joint: "
        "encoder, pressure_a, pressure_b, pressures, valve; of the supply: "
        "supply.pressure",
    )


def parts_of(machine: Machine) -> dict[str, tuple[str, ...]]:
    """Parts of each joint and of the supply that can fail."""
    measured = measured_joints(machine)
    return {
        joint: (ENCODER, *((*CHAMBERS, BOTH_CHAMBERS) if joint in measured else ()), VALVE_PART)
        for joint in machine.joint_names
    } | {SUPPLY: ("pressure",)}


# Sensors and valves that fail while the crane works, one or several, from a moment on.
#
# Sensor faults act on the readings, behind their noise: a stuck one shows one count
# for ever. The devices around them stay as they are: counters and checksums on a bus go on.


@dataclass
class _Running:
    """A fault with its memory. Its clock begins when its part is first seen behind the onset."""

    fault: TimedFault
    law: FaultLaw | None
    zero: float
    begun: float | None = None

    def since(self, time: float) -> float | None:
        """Seconds since it began; None before."""
        if self.begun is None:
            if time < self.zero + (self.fault.onset or 0.0):
                return None
            self.begun = time
        return time - self.begun

    def shown(self, time: float, value: float) -> float:
        since = self.since(time)
        return value if since is None or self.law is None else self.law.shown(since, value)


class Faults:
    """Those of one machine of j joints, k of them with transducers. Times [s] go on.

    Others may be added, and parts repaired, from another thread than that which reads.
    """

    def __init__(
        self,
        machine: Machine,
        faults: Sequence[str] = (),
        seed: int = 0,
        *,
        zero: float = 0.0,
        leaks: bool = True,
    ):
        """`faults` as of `parse`, from `zero` [s] on; `leaks`: whether pistons of the plant can."""
        self._machine, self._zero, self._leaks = machine, zero, leaks
        self._joints, self._measured = machine.joint_names, measured_joints(machine)
        self._rng = np.random.default_rng([seed, 1])
        self._running: tuple[_Running, ...] = ()
        for text in faults:
            self.add(text)

    def add(self, text: str) -> TimedFault:
        """One more; it takes the place of one in the same part. `ConfigurationError` if wrong."""
        fault = parse(text, self._machine)
        if fault.kind == LEAKING and not self._leaks:
            raise ConfigurationError(
                f"fault '{fault}': this plant is identified from a model, whose pistons leak as "
                "the model says; leave --model out"
            )
        kind = KINDS[fault.part][fault.kind]
        law = kind.law(fault.size, self._rng) if kind.law else None
        remaining = (running for running in self._running if running.fault.place != fault.place)
        self._running = (*remaining, _Running(fault, law, self._zero))
        return fault

    def mend(self, place: str) -> None:
        """The part named, `inner_boom.encoder`, or `all`, is well; `ConfigurationError` if not."""
        faulty = [running.fault.place for running in self._running]
        if place not in ("all", *faulty):
            raise ConfigurationError(
                f"'{place}' is not faulty; faulty: {', '.join(faulty) or 'none'}"
            )
        self._running = tuple(
            running for running in self._running if place not in ("all", running.fault.place)
        )

    def positions(self, time: float, q: np.ndarray) -> np.ndarray:
        """Readings (j,) [rad, m] of encoders at a time [s]."""
        return self._changed(ENCODER, time, q)

    def commands(self, time: float, u: np.ndarray) -> np.ndarray:
        """Commands (j,) after faults of the spools, from a time [s] on."""
        return self._changed(VALVE_PART, time, u)

    def passed(self, time: float) -> np.ndarray:
        """(j,) by how much more the pistons leak at a time [s], m3/(s Pa)."""
        leak = np.zeros(len(self._joints))
        for running in self._running:
            if running.fault.kind == LEAKING and running.since(time) is not None:
                leak[self._joints.index(running.fault.target)] = running.fault.size
        return leak

    def pressures(
        self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray, supply: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Readings (n, k), (n, k), (n,) [Pa] at times (n,) [s]; those given if nothing fails."""
        if not self._running:
            return chamber_a, chamber_b, supply
        chambers = {
            CHAMBERS[0]: np.array(chamber_a, dtype=float),
            CHAMBERS[1]: np.array(chamber_b, dtype=float),
        }
        shown_supply = np.array(supply, dtype=float)
        for running in self._running:
            target, part = running.fault.target, running.fault.part
            if target == SUPPLY:
                _pass(running, time, shown_supply)
            elif part in CHAMBERS:
                _pass(running, time, chambers[part][:, self._measured.index(target)])
            elif part == BOTH_CHAMBERS:
                _swap(running, time, *(both[:, self._measured.index(target)]
                                   for both in chambers.values()))  # fmt: skip
        return chambers[CHAMBERS[0]], chambers[CHAMBERS[1]], shown_supply

    def _changed(self, part: str, time: float, values: np.ndarray) -> np.ndarray:
        if not self._running:
            return values
        changed = np.array(values, dtype=float)
        for running in self._running:
            if running.fault.part == part:
                column = self._joints.index(running.fault.target)
                changed[column] = running.shown(time, changed[column])
        return changed


def _pass(running: _Running, time: np.ndarray, values: np.ndarray) -> None:
    for k, at in enumerate(time.tolist()):
        values[k] = running.shown(at, float(values[k]))


def _swap(running: _Running, time: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    faulty = [k for k, at in enumerate(time.tolist()) if running.since(at) is not None]
    a[faulty], b[faulty] = b[faulty], a[faulty]
