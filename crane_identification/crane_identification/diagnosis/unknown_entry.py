"""What findings.json says of an unknown force, and of a dependence as it was drawn."""

from crane_identification.data.units import COUNTS
from crane_identification.diagnosis.answer.differences import Difference
from crane_identification.diagnosis.answer.unknown import Drawing, NearSignature
from crane_identification.diagnosis.diagnosis import Diagnosis
from crane_identification.diagnosis.finding_entry import DrawnShape
from crane_identification.diagnosis.findings_file import (
    FoundDifference,
    NearbySignature,
    UnknownPlace,
)
from crane_identification.diagnosis.variables import unit_of


def unknown_place(diagnosis: Diagnosis) -> UnknownPlace | None:
    """What is known of an unknown force; None where nothing is unknown."""
    found = diagnosis.answer.unknown
    if found is None:
        return None
    return UnknownPlace(
        joint=found.joint,
        strength=found.strength,
        signatures=[_signature(diagnosis, found.joint, one) for one in found.signatures],
        recordings=found.recordings,
        difference=None if found.difference is None else _difference(diagnosis, found.difference),
    )


def drawn_shape(diagnosis: Diagnosis, joint: str, one: Drawing) -> DrawnShape:
    """A dependence on a joint as it was drawn."""
    setting, counts = diagnosis.before.setting, bool(diagnosis.fit.uncalibrated)
    return DrawnShape(
        variable=one.curve.variable,
        variable_unit=unit_of(one.curve.variable, joint, setting, counts),
        knots=list(one.curve.knots),
        values=one.curve.values.tolist(),
        std_devs=one.std_devs.values.tolist(),
        unit=COUNTS if counts and one.unit != "1" else one.unit,
        times=one.curve.times,
    )


def _signature(diagnosis: Diagnosis, joint: str, one: NearSignature) -> NearbySignature:
    return NearbySignature(
        signature=one.said,
        effects=list(one.types),
        explained_share=one.share,
        better=one.better,
        asked=one.asked,
        shapes=[drawn_shape(diagnosis, joint, drawing) for drawing in one.drawn],
    )


def _difference(diagnosis: Diagnosis, one: Difference) -> FoundDifference:
    counts = bool(diagnosis.fit.uncalibrated)
    return FoundDifference(
        parameter=one.parameter,
        unit=COUNTS if counts and one.unit != "1" else one.unit,
        explained_share=one.share,
        changes={name: value for name, (value, _) in one.changes.items()},
        std_devs={name: std_dev for name, (_, std_dev) in one.changes.items()},
    )
