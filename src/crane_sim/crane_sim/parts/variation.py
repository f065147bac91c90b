"""Other machines of the same make: the stand-in with parameters drawn about its own."""

from typing import Any

import numpy as np

from crane_model.actuators.hydraulic import CylinderActuator
from crane_model.configuration import Schema
from crane_model.machine import Machine, MachineJoint
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


def vary_geometry(machine: Machine, seed: int, spread: float) -> Machine:
    """The machine as it was built: not of quite the lengths that its file says.

    The linkage of each cylinder that turns a joint is larger or smaller as a whole, and so is each
    link (a, d of its row of Table 1): factors within +-spread, evenly drawn. Pins that err one by
    one are left out: a four-bar linkage would often not assemble. Piston areas stay, and so does
    what bounds the joints. The same seed gives the same machine.
    """
    rng = np.random.default_rng([seed, 8])  # not the draws of `vary`

    def built(joint: MachineJoint) -> MachineJoint:
        of_linkage, of_link = rng.uniform(1.0 - spread, 1.0 + spread, 2)
        given, row = joint.actuator, joint.dh
        update: dict[str, object] = {}
        if isinstance(given, CylinderActuator) and given.bounded_by_pins:
            update["actuator"] = type(given).model_validate(
                given.model_dump(by_alias=True)
                | {name: of_linkage * getattr(given, name) for name in _lengths(given)}
            )
        if row is not None:
            update["dh"] = row.model_copy(update={"a": row.a * of_link, "d": row.d * of_link})
        return joint.model_copy(update=update)

    return Machine.model_validate(
        machine.model_dump(by_alias=True)
        | {"joints": [built(joint).model_dump(by_alias=True) for joint in machine.joints]}
    )


def _lengths(actuator: CylinderActuator) -> list[str]:
    """The fields that are lengths of the linkage or of the cylinder [m]."""
    angles = ("phi_3", "phi_4", "beta_1", "gamma_25", "pin_rise")
    others = ("count", "mirrored", "type", "pressure_sensors", "area_a_of_one", "area_b_of_one")
    return [name for name in type(actuator).model_fields if name not in (*angles, *others)]


def vary_hydraulics(stand_in: StandIn, seed: int, spread: float) -> StandIn:
    """Valves as quick and as large as others of their make, other hoses and another supply line.

    Spools and rated flows, dead volumes and the supply line each within +-spread, evenly drawn. The
    same seed gives the same ones.
    """
    rng = np.random.default_rng([seed, 9])

    def factor() -> float:
        return float(rng.uniform(1.0 - spread, 1.0 + spread))

    def scaled(given: Schema, *names: str) -> Any:
        return given.model_copy(update={name: getattr(given, name) * factor() for name in names})

    valves, cylinders = stand_in.valves.items(), stand_in.cylinders.items()
    return stand_in.model_copy(
        update={
            "valves": {
                joint: scaled(one, "natural_frequency", "damping_ratio", "rated_flow")
                for joint, one in valves
            },
            "cylinders": {
                joint: scaled(one, "dead_volume_a", "dead_volume_b") for joint, one in cylinders
            },
            "supply": scaled(stand_in.supply, "volume", "pump_droop"),
        }
    )


def vary_sensors(stand_in: StandIn, seed: int, spread: float) -> StandIn:
    """Transducers that are more or less noisy, and a clock that jitters more or less: within
    +-spread, evenly drawn. Encoders, range and converter are those of the data sheet.
    """
    noisier, later = np.random.default_rng([seed, 10]).uniform(1.0 - spread, 1.0 + spread, 2)
    chain = stand_in.sensors
    update = {
        "pressure_noise": chain.pressure_noise * float(noisier),
        "jitter": chain.jitter * float(later),
    }
    return stand_in.model_copy(update={"sensors": chain.model_copy(update=update)})
