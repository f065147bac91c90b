"""Other machines of the same make: the stand-in with parameters drawn about its own."""

import numpy as np

from crane_model.machine import JOINTS
from crane_sim.parameters import Body, CraneBodies, StandIn


def vary(stand_in: StandIn, seed: int, spread: float = 0.15) -> StandIn:
    """Bodies, friction, leakage and oil each within +-spread of those of `stand_in`, evenly drawn.

    Inertia follows the mass of its body; centres of mass move along their axes only, so that the
    base parameters of `planted` stay defined. Friction keeps dissipating; valves, sensors and
    geometry stay. The same seed gives the same machine.
    """
    rng = np.random.default_rng(seed)

    def factor() -> float:
        return float(rng.uniform(1.0 - spread, 1.0 + spread))

    def body(name: str) -> Body:
        given: Body = getattr(stand_in.bodies, name)
        heavier, (along, normal) = factor(), given.centre_of_mass
        along_inertia, normal_inertia, plane = given.principal_inertia
        return given.model_copy(
            update={
                "mass": given.mass * heavier,
                "centre_of_mass": (along * factor(), normal),
                "principal_inertia": (
                    along_inertia * heavier,
                    normal_inertia * heavier,
                    plane * heavier,
                ),
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
        for joint, given in ((joint, stand_in.friction[joint]) for joint in JOINTS)
    }
    cylinders = {
        joint: given.model_copy(update={"leakage": given.leakage * factor()})
        for joint, given in ((joint, stand_in.cylinders[joint]) for joint in JOINTS)
    }
    oil = stand_in.oil
    return stand_in.model_copy(
        update={
            "name": f"{stand_in.name}, drawn with seed {seed}",
            "bodies": CraneBodies(**{name: body(name) for name in CraneBodies.model_fields}),
            "friction": type(stand_in.friction)(**friction),
            "cylinders": type(stand_in.cylinders)(**cylinders),
            "oil": oil.model_copy(update={"bulk_modulus": oil.bulk_modulus * factor()}),
        }
    )
