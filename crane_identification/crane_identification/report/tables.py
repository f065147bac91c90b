"""Rows of the page's tables, as they are printed."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from crane_identification.estimation.estimate import condition_numbers
from crane_identification.notation import (
    NONE,
    Shown,
    percent,
    plain,
    shown,
    spoken,
    unit,
    with_uncertainty,
)
from crane_identification.report import marks
from crane_identification.report.content import IdentificationReport
from crane_identification.report.findings import UNCERTAIN
from crane_identification.report.marks import entry_symbol, parameter_symbol, prose
from crane_model.base_parameters import REPORT_PARAMETERS, REPORT_UNITS, report_from_base
from crane_model.dynamics import Geometry
from crane_model.hydraulics.values import HydraulicValues, JointHydraulics, Measured
from crane_model.model_file import Model
from crane_model.terms import Parameter

# Rows of the hydraulics, as they are printed on the page and in the terminal.

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


class ParameterRow(NamedTuple):
    """One parameter; `planted` and its `deviation` mark are empty where nothing was planted."""

    name: str
    symbol: Markup
    unit: str
    value: str
    std_dev: str
    relative: str
    relative_mark: Markup
    doubtful: bool
    meaning: str
    planted: str
    deviation: Markup


class ParameterGroup(NamedTuple):
    """Parameters of one family and joint under a common heading."""

    heading: str
    rows: list[ParameterRow]


class ErrorRow(NamedTuple):
    """Errors of one joint, in percent."""

    joint: str
    relative: str
    mark: Markup
    moving: str
    without_gravity: str
    noise_floor: str
    training: str
    ratio: str


class MotionRow(NamedTuple):
    """Simulated against measured position of one joint."""

    joint: str
    unit: str
    error: str
    displacement: str
    relative: str


class CommandedRow(NamedTuple):
    """Simulated from commands against measured position of one joint."""

    joint: str
    horizon: str
    error: str
    way: str
    unit: str
    relative: str


class ReportEntry(NamedTuple):
    """One entry of the report's (9)."""

    symbol: Markup
    unit: str
    value: str
    std_dev: str
    relative: str


class Conditioning(NamedTuple):
    """Condition numbers of one set of columns."""

    columns: str
    raw: str
    normalized: str


class Excitation(NamedTuple):
    """How one joint moved in the training data."""

    joint: str
    unit: str
    low: str
    high: str
    speed: str
    acceleration: str
    moving: str
    friction: str
    rows: int


def parameter_groups(report: IdentificationReport) -> list[ParameterGroup]:
    """All parameters in the order of the model."""
    estimate, planted = report.fit.estimate, report.planted or {}
    groups: list[ParameterGroup] = []
    for i, (heading, parameter) in enumerate(with_headings(report.fit.model)):
        value, std_dev = float(estimate.values[i]), float(estimate.std_devs[i])
        printed = shown(value, std_dev, parameter.minimum)
        relative = float(estimate.relative_std_devs[i])
        true = planted.get(parameter.name)
        if not groups or groups[-1].heading != heading:
            groups.append(ParameterGroup(heading, []))
        groups[-1].rows.append(
            ParameterRow(
                name=parameter.name,
                symbol=parameter_symbol(parameter.name),
                unit=unit(parameter.unit),
                value=printed.value,
                std_dev=printed.std_dev,
                relative=printed.relative,
                relative_mark=marks.relative_sigma_mark(relative),
                doubtful=not relative <= UNCERTAIN,
                meaning=prose(parameter.meaning),
                planted=NONE if true is None else with_uncertainty(true, std_dev)[0],
                deviation=marks.deviation_mark(
                    np.nan if true is None else (value - true) / std_dev
                ),
            )
        )
    return groups


def error_rows(report: IdentificationReport) -> list[ErrorRow]:
    """Held-out errors of every joint; none without validation."""
    held_out, trained = report.held_out, report.trained
    if held_out is None:
        return []
    largest = float(np.nanmax([held_out.relative, held_out.noise_floor]))
    return [
        ErrorRow(
            joint=spoken(joint),
            relative=percent(float(held_out.relative[j])),
            mark=marks.error_mark(
                float(held_out.relative[j]), float(held_out.noise_floor[j]), largest
            ),
            moving=percent(float(held_out.moving[j])),
            without_gravity=percent(float(held_out.without_gravity[j])),
            noise_floor=percent(float(held_out.noise_floor[j])),
            training=percent(float(trained.relative[j])),
            ratio=plain(float(held_out.relative[j] / trained.relative[j]), 3),
        )
        for j, joint in enumerate(report.fit.model.joints)
    ]


def motion_rows(report: IdentificationReport) -> list[MotionRow]:
    """Simulated against measured motion of each joint; none where nothing could be simulated."""
    simulated = report.simulated
    if simulated is None or simulated.reason:
        return []
    units = report.fit.model.setting.units
    return [
        MotionRow(spoken(joint), units[joint], plain(error), plain(moved), percent(relative))
        for joint, error, moved, relative in zip(
            simulated.joints,
            simulated.position_rms,
            simulated.displacement_rms,
            simulated.relative,
            strict=True,
        )
    ]


def commanded_rows(report: IdentificationReport) -> list[CommandedRow]:
    """By joint, then by how far ahead; none where the hydraulics are not known."""
    units = report.fit.model.setting.units
    return [
        CommandedRow(
            joint=spoken(joint),
            horizon=plain(one.horizon),
            error=plain(float(one.position_rms[j])),
            way=plain(float(one.way[j])),
            unit=units[joint],
            relative=percent(float(one.relative[j])),
        )
        for j, joint in enumerate(report.fit.model.joints)
        for one in report.commanded
    ]


def report_entries(report: IdentificationReport) -> list[ReportEntry]:
    """The entries of (9) with their standard deviations; none for a model of another machine."""
    model, estimate = report.fit.model, report.fit.estimate
    columns = model.base_parameters
    if model.machine is None or columns is None:
        return []
    mapping = report_from_base(Geometry.of(model.machine))
    seen = np.isfinite(estimate.values[columns])
    # An entry is known if every base parameter in it is.
    known = (mapping[:, ~seen] == 0).all(axis=1)
    values = mapping @ np.nan_to_num(estimate.values[columns])
    spread = mapping @ np.nan_to_num(estimate.covariance[columns, columns]) @ mapping.T
    values, std_devs = (np.where(known, x, np.nan) for x in (values, np.sqrt(np.diag(spread))))
    return [
        ReportEntry(
            entry_symbol(name),
            unit(unit_),
            *_entry(float(value), float(std_dev)),
        )
        for name, unit_, value, std_dev in zip(
            REPORT_PARAMETERS, REPORT_UNITS, values, std_devs, strict=True
        )
    ]


def conditioning(report: IdentificationReport) -> list[Conditioning]:
    """Condition numbers of all columns, and of those of each family of terms by itself."""
    estimate, stacked = report.fit.estimate, report.fit.rows.stacked
    model = report.fit.model
    families = [term.family for term in model.terms for _ in term.parameters(model.setting)]
    rows = [
        Conditioning(
            f"all {len(families)} columns",
            plain(estimate.condition_number),
            plain(estimate.condition_number_normalized),
        )
    ]
    for family in dict.fromkeys(families):
        chosen = [i for i, other in enumerate(families) if other == family]
        if 1 < len(chosen) < len(families):
            raw, normalized = condition_numbers(stacked[:, chosen])
            rows.append(
                Conditioning(f"{family}, {len(chosen)} columns", plain(raw), plain(normalized))
            )
    return rows


def excitation(report: IdentificationReport) -> list[Excitation]:
    """How far and how fast each joint moved in the training data."""
    fit = report.fit
    records = [p.record for p in fit.preparations]
    position, velocity, acceleration = (
        np.concatenate([getattr(record, name) for record in records])
        for name in ("position", "velocity", "acceleration")
    )
    share = np.concatenate([p.moving for p in fit.preparations]).mean(axis=0)
    return [
        Excitation(
            joint=spoken(joint),
            unit=fit.model.setting.units[joint],
            low=plain(float(position[:, j].min())),
            high=plain(float(position[:, j].max())),
            speed=plain(float(np.abs(velocity[:, j]).max())),
            acceleration=plain(float(np.abs(acceleration[:, j]).max())),
            moving=percent(float(share[j])),
            friction=percent(float(report.friction_share[j])),
            rows=int(fit.rows.used[:, j].sum()),
        )
        for j, joint in enumerate(fit.model.joints)
    ]


def with_headings(model: Model) -> Iterator[tuple[str, Parameter]]:
    """Each parameter with the family and the joint of its term."""
    for term in model.terms:
        joint = f", {spoken(term.only_joint)}" if term.only_joint else ""
        for parameter in term.parameters(model.setting):
            yield term.family.capitalize() + joint, parameter


def _entry(value: float, std_dev: float) -> Shown:
    return shown(value, std_dev) if np.isfinite(value) else Shown(NONE, NONE, NONE)
