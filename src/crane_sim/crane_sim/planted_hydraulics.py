"""The planted hydraulics: what `identify` is to find of the stand-in's valves, oil and cylinders.

Under the names and in the units that section `hydraulics` of a model file has;
`crane_model.hydraulics.spool` and `chambers` say what each is. A stand-in that hides effects has
others.
"""

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.parts.parameters import StandIn


def hydraulics_of(parameters: StandIn, machine: Machine, joint: str) -> dict[str, float]:
    """By name [SI]. The gain of a fully open edge depends on where the null of the spool lies: the
    way from the edge to full stroke is longer on one side of it.
    """
    valve, inside = parameters.valves[joint], parameters.cylinders[joint]
    start = parameters.start[[machine.index(joint)]]
    null = float(np.sign(lever_arm(machine, joint, start))[0]) * valve.null_bias
    dead_a, dead_b = valve.dead_zone + null, valve.dead_zone - null
    gain = valve.rated_flow / np.sqrt(valve.rated_drop)
    by_a, by_b = (gain * (1.0 - dead) / (1.0 - valve.dead_zone) for dead in (dead_a, dead_b))
    frequency = 2.0 * np.pi * valve.natural_frequency
    return {
        "dead_zone_a": dead_a,
        "dead_zone_b": dead_b,
        "hysteresis": 0.0,
        "lag": 2.0 * valve.damping_ratio / frequency,
        "natural_frequency": frequency,
        "damping_ratio": valve.damping_ratio,
        "supply_a": by_a * valve.edges.supply_a,
        "a_tank": by_b * valve.edges.a_tank,
        "supply_b": by_b * valve.edges.supply_b,
        "b_tank": by_a * valve.edges.b_tank,
        "bulk_modulus": parameters.oil.bulk_modulus,
        "dead_volume_a": inside.dead_volume_a,
        "dead_volume_b": inside.dead_volume_b,
        "leakage": inside.leakage,
    }
