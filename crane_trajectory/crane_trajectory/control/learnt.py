"""What an adaptive controller has learnt, in words and as hydraulics of a model file."""

from collections.abc import Iterator

import numpy as np

from crane_model.hydraulics.values import HydraulicValues, Measured
from crane_trajectory.control.flow_feedforward import FlowFeedforward

DIRECTIONS = (
    ("extending", "dead_zone_a", ("supply_a", "b_tank")),
    ("retracting", "dead_zone_b", ("a_tank", "supply_b")),
)
"""Name, dead zone and the gains at chambers A and B, as `adaptation` has them."""


def learnt_hydraulics(known: HydraulicValues, led: FlowFeedforward) -> HydraulicValues:
    """The values of which the controller was made, `known`, with what it has learnt since."""
    joints = dict(known.joints)
    for joint, learnt in zip(led.joints, led.memory.learnt, strict=True):
        valve = joints[joint].valve
        changes: dict[str, Measured] = {}
        for (_, dead_zone, gains), one in zip(DIRECTIONS, learnt, strict=True):
            values, std_dev = one[0], np.sqrt(np.diag(one[1:]))
            if values[0] == getattr(valve, dead_zone).value:
                continue  # nothing was learnt in this direction
            changes[dead_zone] = _measured(values[0], std_dev[0], valve.units[dead_zone])
            for k, name in enumerate(gains, start=1):
                whole_stroke = getattr(valve, name).value * (1.0 - values[0]) / values[k]
                changes[name] = _measured(
                    whole_stroke, whole_stroke * std_dev[k] / values[k], valve.units[name]
                )
        if changes:
            joints[joint] = joints[joint].model_copy(
                update={"valve": valve.model_copy(update=changes)}
            )
    provenance = known.provenance.removesuffix(LEARNT) + LEARNT
    return known.model_copy(update={"joints": joints, "provenance": provenance})


LEARNT = "; dead zones and flow gains learnt while following"


def in_words(led: FlowFeedforward) -> Iterator[tuple[str, str]]:
    """What, and its value, of every joint and direction."""
    for joint, learnt in zip(led.joints, led.memory.learnt, strict=True):
        for (direction, _, _), one in zip(DIRECTIONS, learnt, strict=True):
            dead_zone, std_dev = one[0, 0], np.sqrt(one[1, 0])
            gains = (1.0 - dead_zone) / one[0, 1:]
            yield (
                f"learnt, {joint} {direction}: dead zone, gains at A and B over those of the model",
                f"{dead_zone:.4f} ± {std_dev:.4f}, {gains[0]:.3f}, {gains[1]:.3f}",
            )


def _measured(value: float, std_dev: float, unit: str) -> Measured:
    return Measured(value=float(value), std_dev=float(std_dev), unit=unit)
