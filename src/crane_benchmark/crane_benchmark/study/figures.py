"""The figures that the study measures, for the manual."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from crane_benchmark.measured import MeasuredRow, of_joints
from crane_benchmark.study.following import AHEAD, HYDRAULIC_AIMS, TRAINED, Followed
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_trajectory.control.choice import OF_THE_MODEL, PD_DEAD_BAND
from crane_trajectory.excitation.criterion import information, one_period, relative_std_devs
from crane_trajectory.excitation.limits import load_design_settings
from crane_trajectory.motion.periodic import FourierTrajectory

RMS_AIM = "0.4 mrad, 0.6 mrad, 0.4 mm, and 40, 60, 20 times better than (36)"
MILLI = 1e3
STUDY_COMMAND = "make study"
SHOWN = (1, 2, 3)  # trajectories, beside all of them


def following_rows(followed: Followed) -> Iterator[MeasuredRow]:
    """Values, motion from commands, and what each controller leaves."""
    for what, aim in HYDRAULIC_AIMS.items():
        found = followed.farthest_off(aim)
        yield MeasuredRow(
            cells=[
                f"{what} from that bag, farthest off; its σ",
                aim.told(aim.live),
                f"{aim.told(found.error)}; {aim.told(found.std_dev)}",
            ],
            values={f"{_key(what)}_error": found.error, f"{_key(what)}_std_dev": found.std_dev},
        )
    for row in followed.summary["simulated_from_commands"]:
        horizon = row["horizon"]
        shares = {joint: row["position_rms"][joint] / row["path"][joint] for joint in row["path"]}
        yield MeasuredRow(
            cells=[
                f"motion from valve commands alone, {horizon:g} s ahead, held out "
                f"({', '.join(shares)})",
                f"{AHEAD[horizon]:.1%}",
                ", ".join(f"{{ahead_{horizon:g}_{joint}:.3%}}" for joint in shares),
            ],
            values={f"ahead_{horizon:g}_{joint}": share for joint, share in shares.items()},
        )
    for name, by_law in followed.rms.items():
        for law in (PD_DEAD_BAND, *OF_THE_MODEL):
            yield _law_row(name, law, by_law[law], by_law[PD_DEAD_BAND], followed.joints)


def _law_row(
    name: str, law: str, rms: Mapping[str, float], before: Mapping[str, float], joints: list[str]
) -> MeasuredRow:
    keys = [f"{name}_{law}_{joint}" for joint in joints]
    values = {key: MILLI * rms[joint] for key, joint in zip(keys, joints, strict=True)}
    shown = "/".join(f"{{{key}:.3g}}" for key in keys)
    seen = "" if name == TRAINED else ", which nothing was fitted to"
    if law == PD_DEAD_BAND:
        what = f"rms error on {name}{seen}, PD controller ({'/'.join(joints)}) [mrad, mm]"
        return MeasuredRow(cells=[what, "", shown], values=values)
    better = {f"{key}_better": before[j] / rms[j] for key, j in zip(keys, joints, strict=True)}
    times = "/".join(f"{{{key}_better:.0f}}" for key in keys)
    return MeasuredRow(
        cells=[f"the same by `{law}`", RMS_AIM, f"{shown}; {times} times better"],
        values=values | better,
    )


def _key(what: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in what)


class Took(NamedTuple):
    """A step of the study, and its time [s]: by the clock, and of all processors."""

    step: str
    wall: float
    cpu: float


def rows(
    summary: Mapping[str, Any],
    true_values: Mapping[str, float],
    trajectories: Sequence[FourierTrajectory],
    took: Sequence[Took],
) -> Iterator[MeasuredRow]:
    """Rows from fit, true values, designs, and time of all steps (empty if some existed)."""
    yield _campaign(trajectories)
    yield MeasuredRow(
        cells=[
            f"{len(summary['parameters'])} parameters: farthest off, by the fit and by the "
            "recursion",
            "",
            "{fit_sigmas:.1f} σ, {recursion_sigmas:.1f} σ",
        ],
        values={
            "fit_sigmas": _farthest(summary["parameters"], true_values),
            "recursion_sigmas": _farthest(summary["recursive"]["parameters"], true_values),
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
        steps = ", ".join(step.step for step in took)
        yield MeasuredRow(
            cells=[
                f"`{STUDY_COMMAND}` after the set-up: all of it; {steps}; CPU time of these",
                "10 min on 2 cores",
                "; ".join(
                    [
                        "{wall:.0f} s",
                        ", ".join(f"{{wall_{i}:.0f}}" for i in range(len(took))) + " s",
                        ", ".join(f"{{cpu_{i}:.0f}}" for i in range(len(took))) + " s",
                    ]
                ),
            ],
            values={"wall": sum(step.wall for step in took)}
            | {f"wall_{i}": step.wall for i, step in enumerate(took)}
            | {f"cpu_{i}": step.cpu for i, step in enumerate(took)},
        )


def _campaign(trajectories: Sequence[FourierTrajectory]) -> MeasuredRow:
    """The largest standard deviation that is predicted after some trajectories, and after all."""
    model = load_model(machine_file("model.yaml"))
    settings = load_design_settings(machine_file("design.yaml"))
    told = np.cumsum(
        [
            information(
                model,
                one_period(model, trajectory, settings.search.samples),
                trajectory.period,
                settings.experiment,
            )
            for trajectory in trajectories
        ],
        axis=0,
    )
    counts = [*(n for n in SHOWN if n < len(trajectories)), len(trajectories)]
    return MeasuredRow(
        cells=[
            "campaign at the paper's setting: worst predicted σ after "
            f"{', '.join(map(str, counts))} trajectories",
            "",
            ", ".join(f"{{after_{n}:.2%}}" for n in counts),
        ],
        values={
            f"after_{n}": max(relative_std_devs(model, told[n - 1], settings.plausible).values())
            for n in counts
        },
    )


def _farthest(parameters: Sequence[Mapping[str, Any]], true_values: Mapping[str, float]) -> float:
    return max(
        abs(parameter["value"] - true_values[parameter["name"]]) / parameter["std_dev"]
        for parameter in parameters
    )
