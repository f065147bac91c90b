"""The figures that the study measures, for the manual."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from crane_benchmark.measured import MeasuredRow, of_joints
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_trajectory.excitation.criterion import information, one_period, relative_std_devs
from crane_trajectory.excitation.limits import load_design_settings
from crane_trajectory.motion.periodic import FourierTrajectory

COMMAND = "make study"
SHOWN = (1, 2, 3)  # trajectories, beside all of them


class Took(NamedTuple):
    """A step of the study, and its time [s]: by the clock, and of all processors."""

    step: str
    wall: float
    cpu: float


def rows(
    summary: Mapping[str, Any],
    planted: Mapping[str, float],
    trajectories: Sequence[FourierTrajectory],
    took: Sequence[Took],
) -> Iterator[MeasuredRow]:
    """From the summary of the fit, what was planted, the designs, and the time of all steps, which
    is empty where something had been made before.
    """
    yield _campaign(trajectories)
    yield MeasuredRow(
        cells=[
            f"{len(summary['parameters'])} planted parameters: farthest off, by the fit and by the "
            "recursion",
            "",
            "{fit_sigmas:.1f} σ, {recursion_sigmas:.1f} σ",
        ],
        values={
            "fit_sigmas": _farthest(summary["parameters"], planted),
            "recursion_sigmas": _farthest(summary["recursive"]["parameters"], planted),
        },
    )
    joints = ", ".join(summary["heldout_relative_error"])
    for name, what, errors in (
        ("fit", f"its held-out force, relative to τ ({joints})", summary["heldout_relative_error"]),
        ("recursion", "the same by the recursion", summary["recursive"]["heldout_relative_error"]),
        ("noise", "scatter between periods", summary["noise_floor"]),
        ("without_gravity", "the error relative to τ without gravity",
         summary["heldout_relative_error_without_gravity"]),
    ):  # fmt: skip
        yield of_joints(name, what, errors, ".2%")
    training = summary["training_relative_error"]
    ratios = {j: error / training[j] for j, error in summary["heldout_relative_error"].items()}
    yield of_joints("over_training", "held-out over training error", ratios, ".2f", "1.2")
    if took:
        steps = ", ".join(one.step for one in took)
        yield MeasuredRow(
            cells=[
                f"`{COMMAND}` after the set-up: all of it; {steps}; CPU time of these",
                "10 min on 2 cores",
                "; ".join(
                    [
                        "{wall:.0f} s",
                        ", ".join(f"{{wall_{i}:.0f}}" for i in range(len(took))) + " s",
                        ", ".join(f"{{cpu_{i}:.0f}}" for i in range(len(took))) + " s",
                    ]
                ),
            ],
            values={"wall": sum(one.wall for one in took)}
            | {f"wall_{i}": one.wall for i, one in enumerate(took)}
            | {f"cpu_{i}": one.cpu for i, one in enumerate(took)},
        )


def _campaign(trajectories: Sequence[FourierTrajectory]) -> MeasuredRow:
    """The largest standard deviation that is predicted after some trajectories, and after all."""
    model = load_model(machine_file("model.yaml"))
    settings = load_design_settings(machine_file("design.yaml"))
    told = np.cumsum(
        [
            information(
                model,
                one_period(model, one, settings.search.samples),
                one.period,
                settings.experiment,
            )
            for one in trajectories
        ],
        axis=0,
    )
    counts = [*(n for n in SHOWN if n < len(trajectories)), len(trajectories)]
    return MeasuredRow(
        cells=[
            "campaign at the report's setting: worst predicted σ after "
            f"{', '.join(map(str, counts))} trajectories",
            "",
            ", ".join(f"{{after_{n}:.2%}}" for n in counts),
        ],
        values={
            f"after_{n}": max(relative_std_devs(model, told[n - 1], settings.plausible).values())
            for n in counts
        },
    )


def _farthest(parameters: Sequence[Mapping[str, Any]], planted: Mapping[str, float]) -> float:
    return max(abs(one["value"] - planted[one["name"]]) / one["std_dev"] for one in parameters)
