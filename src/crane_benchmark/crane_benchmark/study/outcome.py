"""What the study prints."""

from typing import Any

from rich.table import Table

from crane_benchmark.study.following import Followed
from crane_benchmark.study.hydraulic_aims import AIMS
from crane_identification.report.terminal import estimate, plain_table, rounded


def parameter_table(summary: dict[str, Any], planted: dict[str, float]) -> Table:
    """Each parameter: planted, by the recursion and by the fit to averaged periods."""
    table = plain_table("Θ: planted in the stand-in machine, and identified from its bags")
    for heading in ("parameter", "unit"):
        table.add_column(heading, no_wrap=True)
    for heading in ("planted", "recursion ± σ", "off/σ", "fit ± σ", "off/σ"):
        table.add_column(heading, justify="right", no_wrap=True)
    for fitted, recursive in zip(
        summary["parameters"], summary["recursive"]["parameters"], strict=True
    ):
        true = planted[fitted["name"]]
        table.add_row(
            fitted["name"],
            fitted["unit"],
            rounded(true, fitted["std_dev"]),
            *estimate(recursive["value"], recursive["std_dev"], true),
            *estimate(fitted["value"], fitted["std_dev"], true),
        )
    return table


def errors_table(summary: dict[str, Any]) -> Table:
    """Held-out errors of every joint, by the fit and by the recursion."""
    table = plain_table("On bags that were not used for fitting: ‖τ-τ̂‖/‖τ‖")
    table.add_column("joint", no_wrap=True)
    for heading in (
        *("fit", "recursion", "noise floor", "fit, τ without gravity"),
        *("in training", "validation/training"),
    ):
        table.add_column(heading, justify="right")
    for joint, error in summary["heldout_relative_error"].items():
        trained = summary["training_relative_error"][joint]
        table.add_row(
            joint,
            f"{error:.3%}",
            f"{summary['recursive']['heldout_relative_error'][joint]:.3%}",
            f"{summary['noise_floor'][joint]:.3%}",
            f"{summary['heldout_relative_error_without_gravity'][joint]:.3%}",
            f"{trained:.3%}",
            f"{error / trained:.2f}",
        )
    return table


def hydraulics_table(followed: Followed) -> Table:
    """How far the hydraulics from one bag behind a bus are off, beside the aims."""
    table = plain_table("Hydraulics, from a bag of (36) behind a bus: farthest off, of all joints")
    table.add_column("values", no_wrap=True)
    for heading in ("error", "its σ", "aim"):
        table.add_column(heading, justify="right", no_wrap=True)
    for what, aim in AIMS.items():
        found = followed.farthest_off(aim)
        table.add_row(what, aim.told(found.error), aim.told(found.std_dev), aim.told(aim.live))
    return table


def controllers_table(followed: Followed) -> Table:
    """What each controller leaves on each trajectory."""
    joints = followed.joints
    table = plain_table("True rms error behind the same bus (mrad, mm), by what that bag told")
    for heading in ("trajectory", "controller"):
        table.add_column(heading, no_wrap=True)
    for joint in joints:
        table.add_column(joint, justify="right")
    for name, by_law in followed.rms.items():
        for law, rms in by_law.items():
            table.add_row(name, law, *(f"{1e3 * rms[joint]:.3g}" for joint in joints))
    return table
