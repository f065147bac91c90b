"""The faults that a part of the simulated crane can have, and how a user writes them."""

import math
from typing import NamedTuple

from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_sim.effects.fault import measured_joints
from crane_sim.faulty.law import (
    BacklashLaw,
    DriftLaw,
    FaultLaw,
    GainLaw,
    LostCountsLaw,
    NoiseLaw,
    OffsetLaw,
    ScaleLaw,
    SlowLaw,
    StuckLaw,
)

SUPPLY, ENCODER, VALVE, BOTH = "supply", "encoder", "valve", "pressures"
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
    BOTH: {SWAPPED: KindOfFault(None)},
    "pressure": _TRANSDUCER,
    VALVE: {
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
        """Which sensor or valve."""
        return f"{self.target}.{self.part}"

    def __str__(self) -> str:
        size = f"={self.size:g}" if KINDS[self.part][self.kind].size else ""
        begin = "" if self.onset is None else f"@{self.onset:g}"
        return f"{self.place}.{self.kind}{size}{begin}"


def parse(text: str, machine: Machine) -> TimedFault:
    """What a user wrote, `inner_boom.encoder.jump=0.02@12.5`; `ConfigurationError` says why not."""

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


def parts_of(machine: Machine) -> dict[str, tuple[str, ...]]:
    """What can fail of each joint and of the supply."""
    measured = measured_joints(machine)
    return {
        joint: (ENCODER, *((*CHAMBERS, BOTH) if joint in measured else ()), VALVE)
        for joint in machine.joint_names
    } | {SUPPLY: ("pressure",)}
