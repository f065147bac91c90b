"""What the demo prints."""

from typing import Any

from laws import Law
from rich.table import Table

from crane_identification.report.terminal import estimate, plain_table, rounded
from crane_model.machine import load_machine


def table(law: Law) -> Table:
    """Parameter, unit, planted, and what was identified online and offline."""
    result = plain_table("Θ: planted in the simulated crane, identified online and from its bag")
    for heading in ("parameter", "unit"):
        result.add_column(heading, no_wrap=True)
    for heading in ("planted", "online ± σ", "off/σ", "offline ± σ", "off/σ"):
        result.add_column(heading, justify="right", no_wrap=True)
    for row in law.read("summary.json")["parameters"]:
        result.add_row(
            row["name"],
            row["unit"],
            rounded(row["planted"], row["batch_std"]),
            *_estimate(row, "rls"),
            *_estimate(row, "batch"),
        )
    return result


def _estimate(row: dict[str, Any], kind: str) -> tuple[str, str]:
    """Value ± standard deviation, and how many of these the value is off."""
    if row[kind] is None:
        return "not determined", ""
    return estimate(row[kind], row[f"{kind}_std"], row["planted"])


def bags_table(law: Law) -> Table:
    """What was recorded, and how well the crane followed."""
    result = plain_table("Messages recorded live at 200 Hz, and gaps of more than 1.5 cycles")
    result.add_column("topic", no_wrap=True)
    for heading in ("fit", "gaps", "validation", "gaps"):
        result.add_column(heading, justify="right")
    summary = law.read("summary.json")
    columns = "bag_messages", "bag_gaps", "validation_bag_messages", "validation_bag_gaps"
    for topic in summary["bag_gaps"]:
        result.add_row(topic, *(str(summary[column][topic]) for column in columns))
    units = load_machine(law.machine).units
    rms = ", ".join(
        f"{joint} {value * 1e3:.0f} m{units[joint]}"
        for joint, value in summary["tracking_rms"].items()
    )
    result.caption, result.caption_justify = f"RMS tracking error: {rms}", "left"
    return result


def errors_table(law: Law, dynamic_law: Law) -> Table:
    """Held-out errors per joint."""
    result = plain_table("On the bag that was not used for fitting: error of force and of motion")
    result.add_column("joint", no_wrap=True)
    for heading in (
        *("‖τ-τ̂‖/‖τ‖", "without gravity", "noise floor", "with LuGre"),
        *("motion 0.5 s ahead", "friction in τ"),
    ):
        result.add_column(heading, justify="right")
    summary, dynamic = law.read("summary.json"), dynamic_law.read("summary.json")
    motion = summary["simulated_motion"]
    for joint, error in summary["heldout_relative_error"].items():
        result.add_row(
            joint,
            f"{error:.2%}",
            f"{summary['heldout_relative_error_without_gravity'][joint]:.2%}",
            f"{summary['noise_floor'][joint]:.2%}",
            f"{dynamic['heldout_relative_error'][joint]:.2%}",
            f"{motion['position_rms'][joint] / motion['displacement_rms'][joint]:.2%}",
            f"{summary['friction_share'][joint]:.0%}",
        )
    return result
