"""Messages to a user: which sensor, what is wrong, how much, since when, and the remedy."""

from enum import StrEnum
from typing import NamedTuple

SUPPLY = "supply"
COVERED = 1.96  # standard deviations to either side, of 95 %


class Wrong(StrEnum):
    """Kind of a sensor fault."""

    STUCK = "stuck"
    JUMP = "jump"
    DRIFT = "drift"
    SCALE = "scale"
    NOISE = "noise"
    BACKLASH = "backlash"
    ERRATIC = "erratic"
    OFFSET = "offset"
    GAIN = "gain"
    SWAPPED = "swapped"
    SLOW = "slow"
    LEAKING = "leaking"
    OPEN = "open"


class Part(StrEnum):
    """Part that has a fault."""

    ENCODER = "encoder"
    PRESSURE_A = "pressure A"
    PRESSURE_B = "pressure B"
    PRESSURES = "pressures A and B"
    SUPPLY = "supply pressure"
    VALVE = "valve"


TRANSDUCERS = Part.PRESSURE_A, Part.PRESSURE_B  # each compared in the channel of its chamber
ADVICE = {
    Part.ENCODER: {
        Wrong.STUCK: "stop; check the encoder's shaft, coupling and cable",
        Wrong.JUMP: "stop; check coupling and cable, then compare it with its mark",
        Wrong.DRIFT: "stop; check the coupling and the screws of its mounting",
        Wrong.SCALE: "stop; check for lost counts, and its setting",
        Wrong.ERRATIC: "stop; check coupling, mounting and cable",
        Wrong.NOISE: "check shield and earth of its cable",
        Wrong.BACKLASH: "tighten its mounting and coupling",
    },
    Part.PRESSURES: {Wrong.SWAPPED: "swap the two plugs, or their names in the CAN mapping"},
    Part.VALVE: {
        Wrong.STUCK: "stop; check the valve's plug and its supply, then its spool",
        Wrong.SLOW: "check oil temperature and pilot pressure, then the spool",
        Wrong.LEAKING: "check the piston's seals; the cylinder passes oil",
        Wrong.OPEN: "stop; check the valve's null and its spool: oil passes it",
    },
}
TRANSDUCER_ADVICE = {
    Wrong.OFFSET: "depressurise and read its zero; set the zero or replace it",
    Wrong.DRIFT: "depressurise and read its zero; replace it if the drift continues",
    Wrong.GAIN: "compare it with a gauge; replace it",
    Wrong.STUCK: "check its plug and cable; replace it",
    Wrong.NOISE: "check shield and earth of its cable",
}
AFTERWARDS = "; do not identify from recordings since then"
DISPLAYED = {
    "Pa": (1e-5, "bar"),
    "Pa/s": (1e-5, "bar/s"),
    "m": (1e3, "mm at the piston"),
    "m/s": (1e3, "mm/s at the piston"),
    "1": (100.0, "%"),
    "m3/(s Pa)": (1.0, "m3/(s Pa)"),
}
"""Factor and unit in which a size is told, by its SI unit."""


class RivalEncoder(NamedTuple):
    """An encoder that may be faulty instead of what is named."""

    joint: str
    kind: Wrong


class SensorFinding(NamedTuple):
    """A faulty sensor, or a valve that does not follow its command.

    Parameters
    ----------
    part, joint
        What is faulty; the joint of the supply pressure is "supply".
    kind
        What is wrong with it.
    unit
        Of the size; empty for a kind that has none.
    size, low, high
        Estimate and 95 % interval of the size [unit].
    onset, found
        When it began, and when it was found [s].
    rival
        The encoder that may be faulty instead.
    """

    part: Part
    joint: str
    kind: Wrong
    unit: str
    size: float
    low: float
    high: float
    onset: float
    found: float
    rival: RivalEncoder | None = None

    @property
    def sensor(self) -> str:
        """Joint and part, for example 'telescope encoder'."""
        return str(self.part) if self.part is Part.SUPPLY else f"{self.joint} {self.part}"

    @property
    def dangerous(self) -> bool:
        """Return whether the position may not be known any more."""
        noisy = self.kind is Wrong.NOISE
        return self.rival is not None or (self.part is Part.ENCODER and not noisy)

    @property
    def what_to_do(self) -> str:
        """Advice, as a sentence without its end."""
        special = ADVICE.get(self.part, {}).get(self.kind)
        advice = (special or TRANSDUCER_ADVICE[self.kind]) + AFTERWARDS
        if self.rival is None:
            return advice
        joint, kind = self.rival
        return (
            f"stop: the {joint} encoder ({kind}) would explain it too, compare it with its mark; "
            f"if it is right, {advice.removeprefix('stop; ')}"
        )

    @property
    def how_much(self) -> str:
        """The size with its interval, in words; empty for a kind that has none."""
        if not self.unit:
            return ""
        factor, unit = DISPLAYED.get(self.unit, (1.0, self.unit))
        size, low, high = (factor * value for value in (self.size, self.low, self.high))
        return f"{size:.3g} {unit} ({low:.3g} to {high:.3g})"

    def __str__(self) -> str:
        much = f" {self.how_much}" if self.unit else ""
        return f"{self.sensor}: {self.kind}{much}, since {self.onset:.2f} s; {self.what_to_do}"
