"""Sensors and valves that fail while the crane works, one or several, from a moment on.

What a sensor does wrong is done to its readings, behind its noise: a stuck one shows one count for
ever. The devices around them stay as they are: counters and checksums on a bus go on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_sim.effects.fault import measured_joints
from crane_sim.faulty.kinds import (
    BOTH,
    CHAMBERS,
    ENCODER,
    KINDS,
    LEAKING,
    SUPPLY,
    VALVE,
    TimedFault,
    parse,
)
from crane_sim.faulty.law import FaultLaw


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
        """What comes of a value at a time [s]."""
        since = self.since(time)
        return value if since is None or self.law is None else self.law.shown(since, value)


class Faults:
    """Those of one machine of j joints, k of them with transducers. Times [s] go on.

    Others may be added, and parts mended, from another thread than that which reads.
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
        """`faults` as `parse` reads them; their onsets count from `zero` [s]; `leaks` says whether
        this plant's pistons can.
        """
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
                f"fault '{fault}': this plant is the twin of a model, whose pistons leak as the "
                "model says; leave --model out"
            )
        kind = KINDS[fault.part][fault.kind]
        law = kind.law(fault.size, self._rng) if kind.law else None
        others = (one for one in self._running if one.fault.place != fault.place)
        self._running = (*others, _Running(fault, law, self._zero))
        return fault

    def mend(self, place: str) -> None:
        """The part named, `inner_boom.encoder`, or `all`, is well; `ConfigurationError` if not."""
        faulty = [one.fault.place for one in self._running]
        if place not in ("all", *faulty):
            raise ConfigurationError(
                f"'{place}' is not faulty; faulty: {', '.join(faulty) or 'none'}"
            )
        self._running = tuple(one for one in self._running if place not in ("all", one.fault.place))

    def positions(self, time: float, q: np.ndarray) -> np.ndarray:
        """Readings (j,) [rad, m] of encoders at a time [s]."""
        return self._changed(ENCODER, time, q)

    def commands(self, time: float, u: np.ndarray) -> np.ndarray:
        """What spools make of commands (j,), from a time [s] on."""
        return self._changed(VALVE, time, u)

    def passed(self, time: float) -> np.ndarray:
        """(j,) by how much more the pistons leak at a time [s], m3/(s Pa)."""
        leak = np.zeros(len(self._joints))
        for one in self._running:
            if one.fault.kind == LEAKING and one.since(time) is not None:
                leak[self._joints.index(one.fault.target)] = one.fault.size
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
        for one in self._running:
            target, part = one.fault.target, one.fault.part
            if target == SUPPLY:
                _pass(one, time, shown_supply)
            elif part in CHAMBERS:
                _pass(one, time, chambers[part][:, self._measured.index(target)])
            elif part == BOTH:
                _swap(one, time, *(both[:, self._measured.index(target)]
                                   for both in chambers.values()))  # fmt: skip
        return chambers[CHAMBERS[0]], chambers[CHAMBERS[1]], shown_supply

    def _changed(self, part: str, time: float, values: np.ndarray) -> np.ndarray:
        """The values themselves where nothing fails."""
        if not self._running:
            return values
        changed = np.array(values, dtype=float)
        for one in self._running:
            if one.fault.part == part:
                column = self._joints.index(one.fault.target)
                changed[column] = one.shown(time, changed[column])
        return changed


def _pass(one: _Running, time: np.ndarray, values: np.ndarray) -> None:
    for k, at in enumerate(time.tolist()):
        values[k] = one.shown(at, float(values[k]))


def _swap(one: _Running, time: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    faulty = [k for k, at in enumerate(time.tolist()) if one.since(at) is not None]
    a[faulty], b[faulty] = b[faulty], a[faulty]
