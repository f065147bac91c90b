"""What the demo prints."""

from collections.abc import Mapping

from outcome import DemoOutcome, OnlineEstimate, motion_errors
from rich.table import Table

from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_identification.report.summary import ParameterSummary, Summary
from crane_identification.report.terminal import estimate, plain_table, rounded
from crane_model import load_machine


def table(law: CraneRun, outcome: DemoOutcome) -> Table:
    """Parameter, unit, true value, and what was identified online and offline."""
    result = plain_table("Parameters: true values, online estimates, and the fit to the bag")
    for heading in ("parameter", "unit"):
        result.add_column(heading, no_wrap=True)
    for heading in ("true value", "online ± σ", "error/σ", "offline ± σ", "error/σ"):
        result.add_column(heading, justify="right", no_wrap=True)
    true_values = law.true_values()
    online = {estimate.name: estimate for estimate in outcome.online}
    for fitted in law.summary().parameters:
        true = true_values[fitted.name]
        result.add_row(
            fitted.name,
            fitted.unit,
            rounded(true, fitted.std_dev) if fitted.std_dev else f"{true:.6g}",
            *_estimate(online.get(fitted.name), true),
            *_estimate(fitted, true),
        )
    return result


def _estimate(found: ParameterSummary | OnlineEstimate | None, true: float) -> tuple[str, str]:
    """Value ± standard deviation, and how many of these the value is off."""
    if found is None or found.value is None or not found.std_dev:
        return "not determined", ""
    return estimate(found.value, found.std_dev, true)


def bags_table(law: CraneRun, outcome: DemoOutcome) -> Table:
    """What was recorded, and how well the crane followed."""
    result = plain_table("Messages recorded live, and gaps of more than 1.5 cycles")
    result.add_column("topic", no_wrap=True)
    for heading in ("fit", "gaps", "validation", "gaps"):
        result.add_column(heading, justify="right")
    recordings = [outcome.recorded[use] for use in ("train", "validate")]
    for topic in recordings[0].gaps:
        counts = ((recording.messages[topic], recording.gaps[topic]) for recording in recordings)
        result.add_row(topic, *(str(count) for pair in counts for count in pair))
    units = load_machine(law.machine).units
    rms = ", ".join(
        f"{joint} {value * 1e3:.0f} m{units[joint]}"
        for joint, value in outcome.tracking_rms.items()
        if value is not None
    )
    result.caption, result.caption_justify = f"RMS tracking error: {rms}", "left"
    return result


def errors_table(summary: Summary, dynamic: Summary) -> Table:
    """Held-out errors per joint."""
    result = plain_table("Errors of force and motion on the held-out bag")
    result.add_column("joint", no_wrap=True)
    motion, errors = motion_errors(summary)
    columns: dict[str, Mapping[str, float | None]] = {
        "‖τ-τ̂‖/‖τ‖": summary.heldout_relative_error,
        "without gravity": summary.heldout_relative_error_without_gravity,
        "noise floor": summary.noise_floor,
        "with LuGre": dynamic.heldout_relative_error,
        motion: errors,
        "friction in τ": summary.friction_share,
    }
    for heading in columns:
        result.add_column(heading, justify="right")
    for joint in summary.heldout_relative_error:
        values = (column.get(joint) for column in columns.values())
        result.add_row(joint, *("" if value is None else f"{value:.2%}" for value in values))
    return result
