"""The recursion over the training recordings beside the fit: its table and how it settled."""

from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from crane_identification.notation import percent, plain, shown, spoken, unit
from crane_identification.report.content import IdentificationReport
from crane_identification.report.figure import (
    MEASURED,
    MODEL,
    PLANTED,
    SCATTER,
    Band,
    Curve,
    Figure,
    Panel,
)
from crane_identification.report.marks import parameter_symbol
from crane_identification.report.tables import with_headings

PANELS = 4  # of a figure, above each other
SETTLED = 0.2
"""Share of the time after which all of an estimate is to be seen: before, it is off its panel."""


class RecursiveRow(NamedTuple):
    """One parameter by the recursion and by the fit; `difference` in standard deviations."""

    symbol: Markup
    unit: str
    value: str
    std_dev: str
    fitted: str
    fitted_std_dev: str
    difference: str


class RecursiveGroup(NamedTuple):
    """Parameters of one family and joint under a common heading."""

    heading: str
    rows: list[RecursiveRow]


class RecursiveError(NamedTuple):
    """Held-out error of one joint."""

    joint: str
    recursive: str
    fitted: str


def recursive_groups(report: IdentificationReport) -> list[RecursiveGroup]:
    """All parameters in the order of the model; none without the recursion."""
    recursive, estimate = report.recursive, report.fit.estimate
    if recursive is None:
        return []
    groups: list[RecursiveGroup] = []
    for i, (heading, parameter) in enumerate(with_headings(report.fit.model)):
        value, std_dev = float(recursive.values[-1, i]), float(recursive.std_devs[-1, i])
        fitted, fitted_std_dev = float(estimate.values[i]), float(estimate.std_devs[i])
        spread = float(np.hypot(std_dev, fitted_std_dev))
        if not groups or groups[-1].heading != heading:
            groups.append(RecursiveGroup(heading, []))
        groups[-1].rows.append(
            RecursiveRow(
                parameter_symbol(parameter.name),
                unit(parameter.unit),
                *shown(value, std_dev, parameter.minimum)[:2],
                *shown(fitted, fitted_std_dev, parameter.minimum)[:2],
                plain((value - fitted) / spread, 2),
            )
        )
    return groups


def recursive_errors(report: IdentificationReport) -> list[RecursiveError]:
    """Of each joint; none without recursion or validation."""
    recursive, fitted = report.recursive_held_out, report.held_out
    if recursive is None or fitted is None:
        return []
    pairs = zip(report.fit.model.joints, recursive.relative, fitted.relative, strict=True)
    return [RecursiveError(spoken(joint), percent(a), percent(b)) for joint, a, b in pairs]


def settling_figures(report: IdentificationReport) -> list[Figure]:
    """Each parameter over the time of the recordings, one after the other."""
    recursive = report.recursive
    if recursive is None:
        return []
    figures: list[Figure] = []
    panels: dict[str, list[Panel]] = {}
    for i, (heading, parameter) in enumerate(with_headings(report.fit.model)):
        panels.setdefault(heading, []).append(_settling(report, i, parameter.name, parameter.unit))
    for heading, all_of in panels.items():
        for first in range(0, len(all_of), PANELS):
            key = f"settling-{len(figures)}"
            figures.append(Figure(key, heading, all_of[first : first + PANELS]))
    return figures


def _settling(report: IdentificationReport, i: int, name: str, unit_: str) -> Panel:
    recursive = report.recursive
    assert recursive is not None
    time, values = recursive.time, recursive.values[:, i]
    spread = 2.0 * np.where(np.isfinite(recursive.std_devs[:, i]), recursive.std_devs[:, i], np.nan)
    fitted = report.fit.estimate.values[i]
    known = {"fit": (MODEL, fitted)}
    if report.planted is not None and name in report.planted:
        known["planted"] = (PLANTED, report.planted[name])
    constants = [
        Curve(which, colour, time[[0, -1]], np.array([value, value]))
        for which, (colour, value) in known.items()
        if np.isfinite(value)
    ]
    settled = time >= SETTLED * time[-1]
    seen = np.concatenate([(values - spread)[settled], (values + spread)[settled]])
    seen = np.append(seen, [curve.values[0] for curve in constants])
    return Panel(
        str(parameter_symbol(name)),
        unit(unit_),
        [*constants, Curve("recursion", MEASURED, time, values, 1.6)],
        [Band("±2 σ", SCATTER, time, values - spread, values + spread)],
        span=_widened(float(np.nanmin(seen)), float(np.nanmax(seen))),
    )


def _widened(low: float, high: float) -> tuple[float, float]:
    room = 0.08 * (high - low) or 1e-3 * abs(high) or 1.0
    return low - room, high + room
