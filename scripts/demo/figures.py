"""The figures that the demo measures, for the manual."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from laws import OUT
from outcome import DemoOutcome, OnlineEstimate, Unplugged, motion_errors

from crane_benchmark.measured import MeasuredRow, of_joints, write
from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_identification.report.summary import ParameterSummary, Summary
from crane_model import load_machine
from crane_model.machine_files import DEFAULT_MACHINE


def write_figures(law: CraneRun, dynamic: CraneRun, outcome: DemoOutcome) -> None:
    """Next to the demo's outcome; those of another machine than the default by its name."""
    command, name = "make demo", "figures.json"
    if law.machine != DEFAULT_MACHINE:
        command, name = f"make demo MACHINE={law.machine}", f"figures_{Path(law.machine).stem}.json"
    units = load_machine(law.machine).units
    found = rows(command, law.summary(), dynamic.summary(), outcome, law.true_values(), units)
    write(OUT / name, command, list(found))


def rows(
    command: str,
    summary: Summary,
    dynamic: Summary,
    outcome: DemoOutcome,
    true_values: Mapping[str, float],
    units: Mapping[str, str],
) -> Iterator[MeasuredRow]:
    """From summaries of the machine and of that with dynamic friction; units by joint."""
    joints = ", ".join(summary.heldout_relative_error)
    motion, ahead = motion_errors(summary)
    yield MeasuredRow(
        cells=[
            f"{len(summary.parameters)} parameters, live: farthest from the true values, "
            "online and offline",
            "",
            "{online_sigmas:.1f} σ, {offline_sigmas:.1f} σ",
        ],
        values={
            "online_sigmas": _farthest(outcome.online, true_values),
            "offline_sigmas": _farthest(summary.parameters, true_values),
        },
    )
    for name, what, errors in (
        ("held_out", f"force on the held-out live bag, relative to τ ({joints})",
         summary.heldout_relative_error),
        ("without_gravity", "the same relative to τ without gravity",
         summary.heldout_relative_error_without_gravity),
        ("noise_floor", "noise floor, relative to τ", summary.noise_floor),
        ("motion", f"simulated {motion}, error relative to the displacement", ahead),
        ("lugre", "the same machine with LuGre friction: held-out force, relative to τ",
         dynamic.heldout_relative_error),
    ):  # fmt: skip
        if known := _known(errors):
            yield of_joints(name, what, known, ".2%")
    yield of_joints("friction_share", "friction in τ", _known(summary.friction_share), ".0%")
    yield _tracked("tracking", "RMS tracking error, PD controller", outcome.tracking_rms, units)
    if followed := outcome.following:
        what = f"the same by `{followed.controller}` with the fitted model"
        yield _tracked("following", what, followed.tracking_rms, units, digits=2)
    if lost := outcome.unplugged:
        yield _unplugged(lost, units)
    yield MeasuredRow(
        cells=[f"`{command}`, after the set-up", "", "{seconds:.0f} s"],
        values={"seconds": sum(outcome.wall_seconds.values())},
    )


def _unplugged(lost: Unplugged, units: Mapping[str, str]) -> MeasuredRow:
    return MeasuredRow(
        cells=[
            f"encoder of {lost.joint} unplugged in motion: named; valves neutral; error of the "
            f"estimate at home; load of {lost.true_load:g} kg estimated in motion",
            "1 s",
            f"{{named:.2f}} s by {lost.named_by}; {{neutral:.2f}} s; "
            f"{{error:.1f}} m{units[lost.joint]}; {{load:.1f}} ± {{load_std_dev:.1f}} kg",
        ],
        values={
            "named": lost.seconds_to_name,
            "neutral": lost.seconds_to_neutral,
            "error": 1e3 * lost.estimate_error,
            "load": lost.load,
            "load_std_dev": lost.load_std_dev,
        },
    )


def _tracked(
    name: str,
    what: str,
    errors: Mapping[str, float | None],
    units: Mapping[str, str],
    digits: int = 0,
) -> MeasuredRow:
    """Errors of joints [rad, m]."""
    known = _known(errors)
    shown = (f"{{{name}_{joint}:.{digits}f}} m{units[joint]}" for joint in known)
    return MeasuredRow(
        cells=[f"{what} ({', '.join(known)})", "", ", ".join(shown)],
        values={f"{name}_{joint}": 1e3 * error for joint, error in known.items()},
    )


def _known(values: Mapping[str, float | None]) -> dict[str, float]:
    return {joint: value for joint, value in values.items() if value is not None}


def _farthest(
    found: Sequence[ParameterSummary | OnlineEstimate], true_values: Mapping[str, float]
) -> float:
    """Of the estimates from the true values, in standard deviations."""
    return max(
        abs(estimate.value - true_values[estimate.name]) / estimate.std_dev
        for estimate in found
        if estimate.value is not None and estimate.std_dev
    )
