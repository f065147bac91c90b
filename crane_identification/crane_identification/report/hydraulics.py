"""Rows of the hydraulics, as they are printed on the page and in the terminal."""

from collections.abc import Mapping
from typing import NamedTuple

from crane_identification.notation import NONE, percent, plain, shown, spoken, with_uncertainty
from crane_model.hydraulics.values import HydraulicValues, JointHydraulics, Measured

MEANING = {
    "dead_zone_a": "dead zone towards chamber A",
    "dead_zone_b": "dead zone towards chamber B",
    "hysteresis": "play between spool and edges",
    "lag": "lag of loop and spool together",
    "natural_frequency": "natural frequency of the spool",
    "damping_ratio": "damping ratio of the spool",
    "supply_a": "gain of the edge from supply to A",
    "a_tank": "gain of the edge from A to tank",
    "supply_b": "gain of the edge from supply to B",
    "b_tank": "gain of the edge from B to tank",
    "bulk_modulus": "effective bulk modulus",
    "dead_volume_a": "dead volume of A",
    "dead_volume_b": "dead volume of B",
    "leakage": "leakage past the piston",
    "pressure": "supply pressure where nothing is drawn",
    "droop": "fall of it with the flow that is drawn",
}


class HydraulicRow(NamedTuple):
    """A value; `note` says how it is known where no recording tells it, `planted` is a dash
    where nothing was.
    """

    name: str
    meaning: str
    value: str
    std_dev: str
    relative: str
    unit: str
    planted: str
    note: str


class HydraulicGroup(NamedTuple):
    """The values of a joint, or of the supply, and how well their equations hold."""

    heading: str
    fit: str
    rows: list[HydraulicRow]


def hydraulic_groups(
    values: HydraulicValues | None, planted: Mapping[str, float] | None = None
) -> list[HydraulicGroup]:
    """Each joint, then the supply; none where nothing was identified. `planted` as NAME.JOINT."""
    if values is None:
        return []
    groups = []
    for joint, one in values.joints.items():
        true = {name: (planted or {}).get(f"{name}.{joint}") for name in one.values}
        rows = _rows(one.values, one.undetermined, true)
        groups.append(HydraulicGroup(spoken(joint), _fit(one), rows))
    if values.supply is not None:
        groups.append(HydraulicGroup("supply", "", _rows(values.supply.by_name, {}, {})))
    return groups


def _fit(one: JointHydraulics) -> str:
    told = f"{percent(one.unexplained)} of the flow unexplained"
    if one.lack_of_fit is None:
        return told
    return f"{told}; noise alone leaves as much with p = {plain(one.lack_of_fit, 2)}"


def _rows(
    values: Mapping[str, Measured],
    undetermined: Mapping[str, str],
    planted: Mapping[str, float | None],
) -> list[HydraulicRow]:
    rows = []
    for name, one in values.items():
        if one.std_dev is None:
            printed, note = (plain(one.value), NONE, NONE), "assumed"
        else:
            printed, note = shown(one.value, one.std_dev), ""
        if name in undetermined:
            note = f"not determined; {undetermined[name]} would tell"
        unit = "" if one.unit == "1" else one.unit
        true = planted.get(name)
        told = NONE if true is None else with_uncertainty(true, one.std_dev or 0.0)[0]
        rows.append(HydraulicRow(name, MEANING[name], *printed, unit, told, note))
    return rows
