"""What is usual of valves and oil: the machine's own values where they are known, else a file's."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from crane_model.configuration import Positive, Schema, load
from crane_model.errors import DataError
from crane_model.flow.valve import EDGES, asymmetry
from crane_model.hydraulics.values import HydraulicValues, JointHydraulics
from crane_model.machine_files import machine_file

SIGMAS = 4.0  # standard deviations of an own value that are no change of it
SAME_COMMAND = 1e-3  # [-1..1] by which dead zones and play that are the same may differ
SAME_ASYMMETRY = 5e-3  # of the gains
SAME_LEAKAGE = 1e-14  # m3/(s Pa)
SAME_OIL = 0.1  # of the bulk modulus, which a little air or warmth changes as much


class Usual(Schema):
    """What is usual of valves and oil; `hydraulics.yaml` says what each is."""

    dead_zone: dict[str, Positive]
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive | dict[str, Positive]
    bulk_modulus: Positive

    @model_validator(mode="after")
    def _of_the_same_joints(self) -> Self:
        match self.leakage:
            case dict() as each if each.keys() != self.dead_zone.keys():
                raise ValueError(
                    f"leakage is given of {', '.join(each)}, dead_zone of "
                    f"{', '.join(self.dead_zone)}; give both of the same joints, or one leakage "
                    "for all"
                )
        return self

    def leakage_of(self, joint: str) -> float:
        """Of a joint [m3/(s Pa)]; infinite where the file has none."""
        match self.leakage:
            case dict() as each:
                return each.get(joint, np.inf)
            case float() as same:
                return same


@dataclass(frozen=True)
class JointUsual:
    """What is usual of one joint, by limits: of dead zones towards chambers A and B, hysteresis and
    leakage the highest, of the bulk modulus the lowest, of the asymmetry both. Those whose names
    are in `own` are about the machine's identified values.
    """

    dead_zones: tuple[float, float]
    hysteresis: float
    asymmetry: tuple[float, float]
    leakage: float
    bulk_modulus: float
    own: frozenset[str] = frozenset()


def usual_of(joint: str, usual: Usual, hydraulics: HydraulicValues | None) -> JointUsual:
    """By the joint's own values as far as they are determined; `DataError` if no dead zone is."""
    known = hydraulics.joints.get(joint) if hydraulics else None
    own = _own(known) if known and known.chambers else {}
    if joint not in usual.dead_zone and "dead_zones" not in own:
        raise DataError(
            f"flow of '{joint}': what is usual of its valve is not known; identify its hydraulics, "
            "or add its dead_zone"
        )
    dead_zone = usual.dead_zone.get(joint, np.inf)
    sheet = JointUsual(
        dead_zones=(dead_zone, dead_zone),
        hysteresis=usual.hysteresis,
        asymmetry=(-usual.asymmetry, usual.asymmetry),
        leakage=usual.leakage_of(joint),
        bulk_modulus=usual.bulk_modulus,
    )
    return replace(sheet, **own, own=frozenset(own))


def _own(known: JointHydraulics) -> dict[str, Any]:
    """Limits about values that are determined, by the names in `JointUsual`."""
    values = known.values

    def beyond(name: str, same: float) -> float:
        one = values[name]
        return one.value + same + SIGMAS * (one.std_dev or 0.0)

    d_a, d_b = values["dead_zone_a"].value, values["dead_zone_b"].value
    strokes = 1.0 - np.array([d_a, d_b, d_b, d_a])  # of EDGES, to fully open
    centre = asymmetry(np.array([values[edge].value for edge in EDGES]) / strokes)
    oil = values["bulk_modulus"]
    limits = {
        "dead_zones": (beyond("dead_zone_a", SAME_COMMAND), beyond("dead_zone_b", SAME_COMMAND)),
        "hysteresis": beyond("hysteresis", SAME_COMMAND),
        "asymmetry": (centre - SAME_ASYMMETRY, centre + SAME_ASYMMETRY),
        "leakage": beyond("leakage", SAME_LEAKAGE),
        "bulk_modulus": (1.0 - SAME_OIL) * oil.value - SIGMAS * (oil.std_dev or 0.0),
    }
    parts = {
        "dead_zones": {"dead_zone_a", "dead_zone_b"},
        "asymmetry": {*EDGES, "dead_zone_a", "dead_zone_b"},
    }
    unknown = set(known.undetermined)
    return {name: one for name, one in limits.items() if not parts.get(name, {name}) & unknown}


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or machine_file("hydraulics.yaml"), Usual)
