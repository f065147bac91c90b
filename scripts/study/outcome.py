"""What the study prints."""

import math
from typing import Any

from rich import box
from rich.table import Table


def parameter_table(summary: dict[str, Any], planted: dict[str, float]) -> Table:
    """Each parameter: planted, by the recursion and by the fit to averaged periods."""
    table = _table("Θ: planted in the stand-in machine, and identified from its bags")
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
            _rounded(true, fitted["std_dev"]),
            *_estimate(recursive, true),
            *_estimate(fitted, true),
        )
    return table


def errors_table(summary: dict[str, Any]) -> Table:
    """Held-out errors of every joint, by the fit and by the recursion."""
    table = _table("On bags that were not used for fitting: ‖τ-τ̂‖/‖τ‖")
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


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _estimate(row: dict[str, Any], true: float) -> tuple[str, str]:
    """Value ± standard deviation, and how many of these the value is off."""
    value, std_dev = row["value"], row["std_dev"]
    return (
        f"{_rounded(value, std_dev)} ± {_rounded(std_dev, std_dev)}",
        f"{(value - true) / std_dev:+.1f}",
    )


def _rounded(value: float, std_dev: float) -> str:
    """The value to the place of the second digit of its standard deviation."""
    places = max(0, 1 - math.floor(math.log10(std_dev)))
    return f"{value:.{places}f}"
