"""The figures that the demo measures, for the manual."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from laws import OUT, Law

from crane_benchmark.measured import MeasuredRow, of_joints, write
from crane_model.machine import load_machine
from crane_model.machine_files import DEFAULT_MACHINE


def write_figures(law: Law, dynamic: Law) -> None:
    """Next to the demo's summary; those of another machine than the default by its name."""
    summaries = law.read("summary.json"), dynamic.read("summary.json")
    command, name = "make demo", "figures.json"
    if law.machine != DEFAULT_MACHINE:
        command, name = f"make demo MACHINE={law.machine}", f"figures_{Path(law.machine).stem}.json"
    units = load_machine(law.machine).units
    write(OUT / name, command, list(rows(command, *summaries, units)))


def rows(
    command: str,
    summary: Mapping[str, Any],
    dynamic: Mapping[str, Any],
    units: Mapping[str, str],
) -> Iterator[MeasuredRow]:
    """From the demo's summary, that of the machine with dynamic friction, and units of joints."""
    parameters = summary["parameters"]
    motion = summary["simulated_motion"]
    joints = ", ".join(summary["heldout_relative_error"])
    yield MeasuredRow(
        cells=[
            f"{len(parameters)} planted parameters, live: farthest off, online and offline",
            "",
            "{online_sigmas:.1f} σ, {offline_sigmas:.1f} σ",
        ],
        values={
            "online_sigmas": _farthest(parameters, "rls"),
            "offline_sigmas": _farthest(parameters, "batch"),
        },
    )
    for name, what, errors in (
        ("held_out", f"force on the held-out live bag, relative to τ ({joints})",
         summary["heldout_relative_error"]),
        ("without_gravity", "the same relative to τ without gravity",
         summary["heldout_relative_error_without_gravity"]),
        ("noise_floor", "noise floor, relative to τ", summary["noise_floor"]),
        ("motion", f"simulated motion {motion['horizon']:g} s ahead, error relative to the way",
         {joint: error / motion["displacement_rms"][joint]
          for joint, error in motion["position_rms"].items()}),
        ("lugre", "the same machine with LuGre friction: held-out force, relative to τ",
         dynamic["heldout_relative_error"]),
    ):  # fmt: skip
        yield of_joints(name, what, errors, ".2%")
    yield of_joints("friction_share", "friction in τ", summary["friction_share"], ".0%")
    tracked = summary["tracking_rms"]
    yield MeasuredRow(
        cells=[
            f"RMS tracking error ({', '.join(tracked)})",
            "",
            ", ".join(f"{{tracking_{joint}:.0f}} m{units[joint]}" for joint in tracked),
        ],
        values={f"tracking_{joint}": 1e3 * error for joint, error in tracked.items()},
    )
    yield MeasuredRow(
        cells=[f"`{command}`, after the set-up", "", "{seconds:.0f} s"],
        values={"seconds": sum(summary["wall_seconds"].values())},
    )


def _farthest(parameters: list[dict[str, Any]], kind: str) -> float:
    """Of the estimates from what is planted, in standard deviations."""
    return max(
        abs(one[kind] - one["planted"]) / one[f"{kind}_std"]
        for one in parameters
        if one[kind] is not None
    )
