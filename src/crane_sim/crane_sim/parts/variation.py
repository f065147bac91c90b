"""Other machines of the same make: the stand-in with parameters drawn about its own."""

import numpy as np

from crane_model.machine import Machine
from crane_sim.parts.parameters import Body, Edges, StandIn, StandInValve

LESS_OVERLAP = 0.15
"""Of a dead zone, at most: how far a drawn one falls short of it. None is larger, so that what a
controller compensates, and a data sheet calls usual, holds for every drawn machine."""


def vary(stand_in: StandIn, seed: int, spread: float = 0.15) -> StandIn:
    """Bodies, friction, leakage and oil each within +-spread of those of `stand_in`, evenly drawn.

    Inertia follows the mass of its body; centres of mass move along the x axis of the body only, so
    that the base parameters of `planted` stay defined. Friction keeps dissipating; valves (see
    `vary_valves`), sensors and geometry stay. The same seed gives the same machine.
    """
    rng = np.random.default_rng(seed)

    def factor() -> float:
        return float(rng.uniform(1.0 - spread, 1.0 + spread))

    def body(given: Body) -> Body:
        heavier, (along, *across) = factor(), given.centre_of_mass
        return given.model_copy(
            update={
                "mass": given.mass * heavier,
                "centre_of_mass": (along * factor(), *across),
                "inertia": tuple(moment * heavier for moment in given.inertia),
                "products": tuple(product * heavier for product in given.products),
            }
        )

    friction = {
        joint: given.model_copy(
            update={
                "f_c": given.f_c * (dry := factor()),
                "df_c": given.df_c * dry * factor(),
                "f_v": given.f_v * (wet := factor()),
                "df_v": given.df_v * wet * factor(),
            }
        )
        for joint, given in stand_in.friction.items()
    }
    cylinders = {
        joint: given.model_copy(update={"leakage": given.leakage * factor()})
        for joint, given in stand_in.cylinders.items()
    }
    oil = stand_in.oil
    return stand_in.model_copy(
        update={
            "name": f"{stand_in.name}, drawn with seed {seed}",
            "bodies": {name: body(given) for name, given in stand_in.bodies.items()},
            "friction": friction,
            "cylinders": cylinders,
            "oil": oil.model_copy(update={"bulk_modulus": oil.bulk_modulus * factor()}),
        }
    )


def vary_valves(stand_in: StandIn, machine: Machine, seed: int, scatter: float = 0.05) -> StandIn:
    """Valves made for differential cylinders, drawn: unequal edges, unequal dead zones.

    The gain of an edge is proportional to the area of its chamber, and within +-scatter of that,
    evenly drawn; the cylinder moves as fast as with equal edges. The dead zones of the two
    directions lie up to `LESS_OVERLAP` below the one of `stand_in`. The same seed gives the same
    valves.
    """
    rng = np.random.default_rng([seed, 4])  # not the draws of `vary`

    def valve(joint: str) -> StandInValve:
        given, cylinder = stand_in.valves[joint], machine.cylinders[joint]
        area_a, area_b = cylinder.area_a, cylinder.area_b
        mean = float(np.hypot(area_a, area_b)) / np.sqrt(2.0)

        def share(area: float) -> float:
            return float(area / mean * rng.uniform(1.0 - scatter, 1.0 + scatter))

        edges = Edges(
            supply_a=share(area_a),
            a_tank=share(area_a),
            supply_b=share(area_b),
            b_tank=share(area_b),
        )
        up, down = given.dead_zone * rng.uniform(1.0 - LESS_OVERLAP, 1.0, 2)
        return given.model_copy(
            update={
                "edges": edges,
                "dead_zone": float(up + down) / 2.0,
                "null_bias": float(up - down) / 2.0,
            }
        )

    return stand_in.model_copy(
        update={"valves": {joint: valve(joint) for joint in stand_in.valves}}
    )
