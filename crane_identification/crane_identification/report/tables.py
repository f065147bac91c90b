"""Rows of the page's tables, as they are printed."""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, log10
from typing import NamedTuple

import numpy as np
from markupsafe import Markup, escape

from crane_identification.estimation.regression import condition_numbers
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
from crane_identification.report.content import IdentificationReport
from crane_identification.report.findings import UNCERTAIN
from crane_identification.validation.motion_validation import MotionValidation
from crane_model.base_parameters import REPORT_PARAMETERS, REPORT_UNITS, report_from_base
from crane_model.dynamics import Geometry
from crane_model.hydraulics import HydraulicValues, JointHydraulics, Measured
from crane_model.model_file import Model
from crane_model.terms import Parameter

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_INDEXED = re.compile(r"(?P<base>[A-Za-z]+)_(?P<body>[A-Za-z]+)")
MARK_WIDTH, MARK_HEIGHT = 132, 14  # px
_LEAST, _MOST = 1e-3, 1.0  # ends of the logarithmic scale of relative standard deviations
_SIGMAS = 5.0  # half the scale of deviations
MEANING = {
    "dead_band_a": "dead band towards chamber A",
    "dead_band_b": "dead band towards chamber B",
    "hysteresis": "hysteresis of the valve",
    "lag": "lag of loop and valve together",
    "natural_frequency": "natural frequency of the valve",
    "damping_ratio": "damping ratio of the valve",
    "supply_a": "gain of the edge from supply to A",
    "a_tank": "gain of the edge from A to tank",
    "supply_b": "gain of the edge from supply to B",
    "b_tank": "gain of the edge from B to tank",
    "bulk_modulus": "effective bulk modulus",
    "dead_volume_a": "dead volume of A",
    "dead_volume_b": "dead volume of B",
    "leakage": "leakage past the piston",
    "pressure": "supply pressure without flow",
    "droop": "drop of the supply pressure with flow",
}


def parameter_symbol(name: str) -> Markup:
    """A parameter without its joint: "S_FL_along" -> S with index, "df_c.inner_boom" -> Δf_c."""
    base, _, index = name.partition(".")[0].partition("_")
    if len(base) == 2 and base[0] == "d":
        base = "Δ" + base[1]
    return _quantity(base, index.replace("_", " "))


def entry_symbol(formula: str) -> Markup:
    """An entry of (9): "m_FL rcm_FL^2 + Izz_FL" -> products of symbols with indices."""
    html, end = Markup(), 0
    for match in _INDEXED.finditer(formula):
        base, index = match["base"], match["body"]
        if len(base) > 1:  # rcm, Izz: a letter and the first part of its index
            base, index = base[0], f"{base[1:]},{index}"
        html += escape(_typeset(formula[end : match.start()])) + _quantity(base, index)
        end = match.end()
    return html + escape(_typeset(formula[end:]))


def prose(text: str) -> str:
    """Quantities in running text: "a2^2", "q4 = 0" -> "a₂²", "q₄ = 0", never broken."""
    return _typeset(re.sub(r"\b([adqr])(\d)", _lowered, text)).replace(" = ", "\u00a0=\u00a0")


def _lowered(match: re.Match[str]) -> str:
    return match[1] + match[2].translate(_SUBSCRIPTS)


def _typeset(text: str) -> str:
    return re.sub(r"\br7\b", "r₇", text).replace("^2", "²")


def _quantity(base: str, index: str) -> Markup:
    html = Markup("<i>{}</i>").format(base) if len(base.strip("Δ")) == 1 else escape(base)
    return html + Markup("<sub>{}</sub>").format(index) if index else html


def relative_sigma_mark(share: float) -> Markup:
    """A bar on a logarithmic scale from 0.1 to 100 %, with a line at 10 %."""
    bar = _logarithmic(share) if isfinite(share) else 0.0
    limit = _logarithmic(UNCERTAIN)
    return _svg(
        _rect("track", 0, MARK_WIDTH) + _rect("spread", 0, bar) + _line("limit", limit),
        f"relative standard deviation {share:.2g}, limit {UNCERTAIN}",
    )


def deviation_mark(sigmas: float) -> Markup:
    """Estimate and its one-sigma interval about the true value, over ±5 σ; ±3 σ shaded.

    An estimate beyond the scale is an arrow at its end.
    """
    if not isfinite(sigmas):
        return Markup()
    middle = MARK_HEIGHT / 2
    axis = Markup('<line class="axis" x1="0" x2="{}" y1="{}" y2="{}"/>')
    return _svg(
        _rect("track", _sigma(-3), _sigma(3))
        + axis.format(MARK_WIDTH, middle, middle)
        + _line("true-value", _sigma(0))
        + (_dot(sigmas, middle) if abs(sigmas) <= _SIGMAS else _arrow(sigmas, middle)),
        f"estimate {sigmas:+.1f} standard deviations from the true value",
    )


def error_mark(error: float, floor: float, largest: float) -> Markup:
    """Held-out error as a bar from 0 to `largest`, with a line at the noise floor."""
    scale = MARK_WIDTH / largest if largest > 0 else 0.0
    bar = error * scale if isfinite(error) else 0.0
    limit = _line("limit", floor * scale) if isfinite(floor) else Markup()
    return _svg(
        _rect("track", 0, MARK_WIDTH) + _rect("bar", 0, bar) + limit,
        f"held-out error {error:.3g}, noise floor {floor:.3g}",
    )


def _logarithmic(share: float) -> float:
    clipped = max(_LEAST, min(_MOST, share))
    return MARK_WIDTH * log10(clipped / _LEAST) / log10(_MOST / _LEAST)


def _sigma(sigmas: float) -> float:
    return MARK_WIDTH * (0.5 + 0.5 * sigmas / _SIGMAS)


def _rect(kind: str, left: float, right: float) -> Markup:
    return Markup('<rect class="{}" x="{:.1f}" width="{:.1f}" y="3" height="{}"/>').format(
        kind, left, max(right - left, 0), MARK_HEIGHT - 6
    )


def _line(kind: str, x: float) -> Markup:
    return Markup('<line class="{}" x1="{:.1f}" x2="{:.1f}" y1="0" y2="{}"/>').format(
        kind, x, x, MARK_HEIGHT
    )


def _svg(content: Markup, words: str) -> Markup:
    return Markup(
        '<svg class="mark" width="{}" height="{}" viewBox="0 0 {} {}" preserveAspectRatio="none" '
        'role="img" aria-label="{}">{}</svg>'
    ).format(MARK_WIDTH, MARK_HEIGHT, MARK_WIDTH, MARK_HEIGHT, words, content)


def _dot(sigmas: float, y: float) -> Markup:
    low, high = (_sigma(max(-_SIGMAS, min(_SIGMAS, sigmas + side))) for side in (-1, 1))
    return Markup(
        '<line class="whisker" x1="{:.1f}" x2="{:.1f}" y1="{}" y2="{}"/>'
        '<circle class="dot" cx="{:.1f}" cy="{}" r="3.2"/>'
    ).format(low, high, y, y, _sigma(sigmas), y)


def _arrow(sigmas: float, y: float) -> Markup:
    tip, back = (MARK_WIDTH, MARK_WIDTH - 8) if sigmas > 0 else (0, 8)
    return Markup('<path class="dot" d="M{},{}L{},{}V{}Z"/>').format(tip, y, back, y - 4, y + 4)


# Rows of the hydraulics, as they are printed on the page and in the terminal.


class HydraulicRow(NamedTuple):
    """A value; `note`: its source without a recording. An unknown `true_value` is a dash."""

    name: str
    meaning: str
    value: str
    std_dev: str
    relative: str
    unit: str
    true_value: str
    note: str


class HydraulicGroup(NamedTuple):
    """The values of a joint, or of the supply, and how well their equations hold."""

    heading: str
    fit: str
    rows: list[HydraulicRow]


def hydraulic_groups(
    values: HydraulicValues | None, true_values: Mapping[str, float] | None = None
) -> list[HydraulicGroup]:
    """Each joint, then the supply; none if nothing was identified; `true_values` by NAME.JOINT."""
    if values is None:
        return []
    groups = []
    for joint, hydraulics in values.joints.items():
        true = {name: (true_values or {}).get(f"{name}.{joint}") for name in hydraulics.values}
        rows = _rows(hydraulics.values, hydraulics.undetermined, true)
        groups.append(HydraulicGroup(spoken(joint), _fit(hydraulics), rows))
    if values.supply is not None:
        groups.append(HydraulicGroup("supply", "", _rows(values.supply.by_name, {}, {})))
    return groups


def _fit(hydraulics: JointHydraulics) -> str:
    told = f"{percent(hydraulics.unexplained)} of the flow unexplained"
    if hydraulics.lack_of_fit is None:
        return told
    return f"{told}; noise alone leaves as much with p = {plain(hydraulics.lack_of_fit, 2)}"


def _rows(
    values: Mapping[str, Measured],
    undetermined: Mapping[str, str],
    true_values: Mapping[str, float | None],
) -> list[HydraulicRow]:
    rows = []
    for name, measured in values.items():
        if measured.std_dev is None:
            printed, note = (plain(measured.value), NONE, NONE), "assumed"
        else:
            printed, note = shown(measured.value, measured.std_dev), ""
        if name in undetermined:
            note = f"not determined; {undetermined[name]} would determine it"
        unit = "" if measured.unit == "1" else measured.unit
        true = true_values.get(name)
        told = NONE if true is None else with_uncertainty(true, measured.std_dev or 0.0)[0]
        rows.append(HydraulicRow(name, MEANING[name], *printed, unit, told, note))
    return rows


class ParameterRow(NamedTuple):
    """One parameter; without a known `true_value`, the `deviation` mark is empty."""

    name: str
    symbol: Markup
    unit: str
    value: str
    std_dev: str
    relative: str
    relative_mark: Markup
    doubtful: bool
    meaning: str
    true_value: str
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
    """Simulated against measured position of one joint, `horizon` s ahead."""

    joint: str
    horizon: str
    error: str
    path: str
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
    estimate, true_values = report.fit.estimate, report.true_values or {}
    groups: list[ParameterGroup] = []
    for i, (heading, parameter) in enumerate(with_headings(report.fit.model)):
        value, std_dev = float(estimate.values[i]), float(estimate.std_devs[i])
        printed = shown(value, std_dev, parameter.minimum)
        relative = float(estimate.relative_std_devs[i])
        true = true_values.get(parameter.name)
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
                relative_mark=relative_sigma_mark(relative),
                doubtful=not relative <= UNCERTAIN,
                meaning=prose(parameter.meaning),
                true_value=NONE if true is None else with_uncertainty(true, std_dev)[0],
                deviation=deviation_mark(np.nan if true is None else (value - true) / std_dev),
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
            mark=error_mark(float(held_out.relative[j]), float(held_out.noise_floor[j]), largest),
            moving=percent(float(held_out.moving[j])),
            without_gravity=percent(float(held_out.without_gravity[j])),
            noise_floor=percent(float(held_out.noise_floor[j])),
            training=percent(float(trained.relative[j])),
            ratio=plain(float(held_out.relative[j] / trained.relative[j]), 3),
        )
        for j, joint in enumerate(report.fit.model.joints)
    ]


def motion_rows(model: Model, validations: Sequence[MotionValidation]) -> list[MotionRow]:
    """By joint, then by how far ahead."""
    return [
        MotionRow(
            joint=spoken(joint),
            horizon=plain(validation.horizon),
            error=plain(float(validation.position_rms[j])),
            path=plain(float(validation.path[j])),
            unit=model.setting.units[joint],
            relative=percent(float(validation.relative[j])),
        )
        for j, joint in enumerate(model.joints)
        for validation in validations
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
        ReportEntry(entry_symbol(name), unit(unit_), *_entry(float(value), float(std_dev)))
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
        chosen = [i for i, column_family in enumerate(families) if column_family == family]
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
