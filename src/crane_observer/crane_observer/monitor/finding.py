"""What a user is told: which sensor, what is wrong, how much, since when, and what to do."""

from typing import NamedTuple

from crane_observer.monitor.signatures import Part, Wrong

DANGEROUS = {Part.ENCODER}
"""Where the crane cannot be led on: it does not know where it is."""

ADVICE = {
    (Part.ENCODER, Wrong.STUCK): "stop; look at the encoder's shaft, coupling and cable",
    (
        Part.ENCODER,
        Wrong.JUMP,
    ): "stop; look at coupling and cable, then compare it with its mark",
    (
        Part.ENCODER,
        Wrong.DRIFT,
    ): "stop; look at the coupling and the screws of its mounting",
    (
        Part.ENCODER,
        Wrong.SCALE,
    ): "stop; look for counts that are lost, and at its setting",
    (Part.ENCODER, Wrong.ERRATIC): "stop; look at coupling, mounting and cable",
    (Part.ENCODER, Wrong.NOISE): "look at shield and earth of its cable",
    (Part.ENCODER, Wrong.BACKLASH): "tighten its mounting and coupling",
    (
        Part.PRESSURES,
        Wrong.SWAPPED,
    ): "change the two plugs over, or their names in the CAN mapping",
    (
        Part.VALVE,
        Wrong.STUCK,
    ): "stop; look at the valve's plug and its supply, then at its spool",
    (
        Part.VALVE,
        Wrong.SLOW,
    ): "look at oil temperature and pilot pressure, then at the spool",
    (Part.VALVE, Wrong.LEAKING): "look at the piston's seals; the cylinder passes oil",
    (
        Part.VALVE,
        Wrong.OPEN,
    ): "stop; look at the valve's null and its spool: oil passes it",
}
TRANSDUCER = {
    Wrong.OFFSET: "depressurise and read its zero; set the zero or replace it",
    Wrong.DRIFT: "depressurise and read its zero; replace it if it goes on",
    Wrong.GAIN: "compare it with a gauge; replace it",
    Wrong.STUCK: "look at its plug and cable; replace it",
    Wrong.NOISE: "look at shield and earth of its cable",
}
AFTERWARDS = "; do not identify from recordings since then"


class RivalEncoder(NamedTuple):
    """An encoder that may lie instead of what is named."""

    joint: str
    kind: Wrong


class SensorFinding(NamedTuple):
    """One that lies, or a valve that does not do what it is told."""

    part: Part
    joint: str  # or "supply"
    kind: Wrong
    unit: str  # of the size, "" where it has none
    size: float
    low: float  # 95 % from here
    high: float
    onset: float  # s
    found: float  # s
    rival: RivalEncoder | None = None

    @property
    def sensor(self) -> str:
        """In words."""
        return str(self.part) if self.part is Part.SUPPLY else f"{self.joint} {self.part}"

    @property
    def dangerous(self) -> bool:
        """Whether the position may not be known any more."""
        return self.rival is not None or (self.part in DANGEROUS and self.kind is not Wrong.NOISE)

    @property
    def what_to_do(self) -> str:
        """As a sentence without its end."""
        advice = (ADVICE.get((self.part, self.kind)) or TRANSDUCER[self.kind]) + AFTERWARDS
        if self.rival is None:
            return advice
        joint, kind = self.rival
        return (
            f"stop: the {joint} encoder ({kind}) would explain it too, compare it with its mark; "
            f"if it is right, {advice.removeprefix('stop; ')}"
        )

    @property
    def how_much(self) -> str:
        """The size with its interval, in words; empty where it has none."""
        if not self.unit:
            return ""
        factor, unit = DISPLAYED.get(self.unit, (1.0, self.unit))
        size, low, high = (factor * one for one in (self.size, self.low, self.high))
        return f"{size:.3g} {unit} ({low:.3g} to {high:.3g})"

    def __str__(self) -> str:
        much = f" {self.how_much}" if self.unit else ""
        return f"{self.sensor}: {self.kind}{much}, since {self.onset:.2f} s; {self.what_to_do}"


DISPLAYED = {
    "Pa": (1e-5, "bar"),
    "Pa/s": (1e-5, "bar/s"),
    "m": (1e3, "mm at the piston"),
    "m/s": (1e3, "mm/s at the piston"),
    "1": (100.0, "%"),
    "m3/(s Pa)": (1.0, "m3/(s Pa)"),
}
