"""The result in a few plain sentences."""

from collections.abc import Sequence

import numpy as np

from crane_identification.notation import is_determined, listed, short_percent, spoken
from crane_identification.report.content import IdentificationReport
from crane_identification.report.findings import UNCERTAIN

TYPICAL_BAGS = 3  # as many are named; more are counted


def verdict(report: IdentificationReport) -> str:
    """Held-out errors against noise floors, and how many parameters are known how well."""
    return f"{_errors(report)} {_parameters(report)}"


def bags(sources: Sequence[str]) -> str:
    """Names of a few recordings, the number of many."""
    if len(sources) <= TYPICAL_BAGS:
        return listed(list(sources))
    return f"{len(sources)} recordings ({sources[0]} … {sources[-1]})"


def _errors(report: IdentificationReport) -> str:
    held_out, joints = report.held_out, report.fit.model.joints
    if held_out is None:
        return "The model has not been validated: no recording was held out."
    parts = []
    for j, joint in enumerate(joints):
        floor = float(held_out.noise_floor[j])
        noise = f"noise {short_percent(floor)}" if np.isfinite(floor) else "noise not known"
        parts.append(
            f"{short_percent(float(held_out.relative[j]))} at the {spoken(joint)} ({noise})"
        )
    return (
        "On data that the fit has not seen, predicted and measured force differ by "
        f"{listed(parts)}."
    )


def _parameters(report: IdentificationReport) -> str:
    estimate, parameters = report.fit.estimate, report.fit.model.parameters
    count = len(parameters)
    determined = sum(
        is_determined(float(value), float(std_dev), parameter.minimum)
        for parameter, value, std_dev in zip(
            parameters, estimate.values, estimate.std_devs, strict=True
        )
    )
    certain = int((estimate.relative_std_devs <= UNCERTAIN).sum())
    which = f"All {count}" if determined == count else f"{determined} of {count}"
    better = "all" if certain == determined else f"{certain}"
    return (
        f"{which} parameters are determined, {better} of them to "
        f"{short_percent(UNCERTAIN)} or better."
    )
