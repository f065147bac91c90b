"""The catalogue of the flow balance: effects that show in the flow of oil, each by one value."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from crane_model.terms.term import Effect


class FlowEffect(NamedTuple):
    """A physical effect, and the symbol and unit of the value that says how much of it there is."""

    effect: Effect
    symbol: str
    unit: str


FLOW_EFFECTS: Mapping[str, FlowEffect] = MappingProxyType(
    {
        "valve_dead_zone": FlowEffect(
            Effect(
                "dead zone of a valve",
                "no flow at small commands, and less by the same amount at all others",
                ("valve_asymmetry", "valve_hysteresis", "internal_leakage"),
                "slow ramps of the command through zero",
            ),
            "dead_zone",
            "1",
        ),
        "valve_hysteresis": FlowEffect(
            Effect(
                "hysteresis of a valve",
                "flow depends on whether the command rises or falls",
                ("valve_dead_zone",),
                "slow triangles of the command, to and fro",
            ),
            "play",
            "1",
        ),
        "valve_asymmetry": FlowEffect(
            Effect(
                "asymmetric gain of a valve",
                "flow per command differs between the two directions, at both chambers",
                ("valve_dead_zone", "internal_leakage"),
                "steps of the command both ways, of several heights",
            ),
            "asymmetry",
            "1",
        ),
        "internal_leakage": FlowEffect(
            Effect(
                "internal leakage",
                "flow from one chamber to the other with the difference of their pressures; "
                "creep at rest",
                ("valve_dead_zone", "valve_asymmetry"),
                "a load held with the valve closed and the lines shut off",
            ),
            "C_leak",
            "m3/(s Pa)",
        ),
        "oil_compressibility": FlowEffect(
            Effect(
                "compressibility of the oil",
                "flow that does not move the piston where the pressures change",
                (),
                "steps of the command against a piston that is blocked",
            ),
            "inv_beta",
            "1/Pa",
        ),
    }
)
