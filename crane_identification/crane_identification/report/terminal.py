"""Terminal output: tables, estimates in their cells, and the results of a fit."""

import math
import sys
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from crane_identification.notation import percent, plain, shown
from crane_identification.report.content import IdentificationReport
from crane_identification.report.tables import hydraulic_groups
from crane_identification.validation.motion_validation import MotionValidation
from crane_model.hydraulics import HydraulicValues
from crane_model.model_file import Model


def console(width: int) -> Console:
    """As wide as the terminal; of `width` characters where the output is none."""
    return Console() if sys.stdout.isatty() else Console(width=width)


def plain_table(title: str | None = None) -> Table:
    """One without frames."""
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))


def rounded(value: float, std_dev: float) -> str:
    """The value to the place of the second digit of its standard deviation, which is above 0."""
    places = max(0, 1 - math.floor(math.log10(std_dev)))
    return f"{value:.{places}f}"


def estimate(value: float, std_dev: float, true: float) -> tuple[str, str]:
    """Value ± standard deviation, and how many of these the value is off."""
    return (
        f"{rounded(value, std_dev)} ± {rounded(std_dev, std_dev)}",
        f"{(value - true) / std_dev:+.1f}",
    )


def parameters(report: IdentificationReport) -> Table:
    """Estimates in the order of the model."""
    result = plain_table()
    result.add_column("parameter", no_wrap=True)
    for heading in ("estimate", "± σ", "σ relative"):
        result.add_column(heading, justify="right", no_wrap=True)
    result.add_column("unit", no_wrap=True)
    found = report.fit.estimate
    for parameter, value, std_dev in zip(
        report.fit.model.parameters, found.values, found.std_devs, strict=True
    ):
        printed = shown(float(value), float(std_dev), parameter.minimum)
        result.add_row(parameter.name, *printed, parameter.unit)
    return result


def hydraulics(values: HydraulicValues | None) -> Table:
    """Valves, oil and supply, joint by joint."""
    result = plain_table()
    for heading in ("hydraulics", "value"):
        result.add_column(heading, no_wrap=True)
    for heading in ("estimate", "± σ", "σ relative"):
        result.add_column(heading, justify="right", no_wrap=True)
    result.add_column("unit", no_wrap=True)
    for group in hydraulic_groups(values):
        for row in group.rows:
            numbers = (row.value, row.std_dev, row.relative)
            result.add_row(group.heading, row.name, *numbers, row.unit)
    return result


def ahead(model: Model, found: MotionValidation) -> Table:
    """Error of a simulation at the end of its windows, joint by joint."""
    result = plain_table()
    headings = (
        f"{plain(found.horizon)} s ahead, {found.windows} windows",
        "error (rms)",
        "path",
        "unit",
        "error / path",
    )
    for heading in headings:
        result.add_column(heading, justify="left" if heading == headings[0] else "right")
    for joint, error, gone, share in zip(
        found.joints, found.position_rms, found.path, found.relative, strict=True
    ):
        unit = model.setting.units[joint]
        result.add_row(joint, plain(float(error)), plain(float(gone)), unit, percent(float(share)))
    return result


def tell(report: IdentificationReport, out: Path) -> None:
    """Prints what was found, and where in `out` the rest is."""
    for warning in report.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    estimate, held_out = report.fit.estimate, report.held_out
    print(f"{len(estimate.names)} parameters from {estimate.samples} equations")
    console(100).print(parameters(report))
    if (found := report.fit.model.hydraulics) is not None:
        console(100).print(hydraulics(found))
        for why in found.unknown.values():
            print(f"not identified: {why}")
    print("force unexplained in training:")
    for joint, error in zip(estimate.joints, estimate.relative_error, strict=True):
        print(f"  {joint}: {percent(float(error))}")
    if held_out is not None:
        print("force unexplained on held-out recordings (noise floor):")
        for joint, error, floor in zip(
            estimate.joints, held_out.relative, held_out.noise_floor, strict=True
        ):
            noise = percent(floor) if np.isfinite(floor) else "not known: no period repeated"
            print(f"  {joint}: {percent(error)} ({noise})")
    if report.commanded:
        print("motion simulated from valve commands alone, against held-out recordings:")
    for validation in report.commanded:
        console(100).print(ahead(report.fit.model, validation))
    if report.simulated is not None and report.simulated.reason:
        print(f"the motion cannot be simulated: {report.simulated.reason}")
    print(f"written: {out}/model.yaml, {out}/summary.json, {out}/report.html")
