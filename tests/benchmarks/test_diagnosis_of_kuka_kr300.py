"""`diagnose` on measurements of a real robot with six axes, by its command line alone.

KUKA KR300 R2500, recordings A, B and C by J. Weigand (MIT): trained on A and B, held out C.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from crane_identification.diagnose import main

MACHINES = Path(__file__).parents[1] / "machines"
MODEL, WITH_SPRING = "kuka_kr300_model.yaml", "kuka_kr300_with_prior.yaml"
AXES = [f"axis_{number}" for number in range(1, 7)]
Measured = Callable[..., None]


class Found:
    """findings.json, and the text that the command prints."""

    def __init__(self, content: dict[str, Any]) -> None:
        self.content = content
        self.verdict = content["verdict"]
        self.effects = {(one["effect"], one["joint"]) for one in content["findings"]}
        self.alone = not any(one["ambiguity_group"] for one in content["findings"])

    def errors(self, side: str) -> list[float]:
        """Held-out errors of the axes in percent, `before` or `after`."""
        told = self.content["model_error"][side]
        return [100.0 * told[axis]["force_relative_error"] for axis in AXES]

    def show(self, measured: Measured, absent: str, right: str) -> None:
        """A row of the manual: what is `right` where this is absent, the answer, and the errors."""
        kinds: dict[str, list[str]] = {}
        for effect, axis in sorted(self.effects):
            kinds.setdefault(effect, []).append(axis.removeprefix("axis_"))
        said = [f"`{kind}` on axes {', '.join(axes)}" for kind, axes in kinds.items()]
        before, after = (self.errors(side) for side in ("before", "after"))
        measured(
            f"left out of the model: {absent}",
            right,
            f"`{self.verdict}`: {'; '.join(said)}; held-out error of axes 1 to 6 "
            f"{_listed(before)} → {_listed(after)} %",
            **{f"before_{axis}": value for axis, value in zip(AXES, before, strict=True)},
            **{f"after_{axis}": value for axis, value in zip(AXES, after, strict=True)},
        )


def _listed(errors: list[float]) -> str:
    return ", ".join(f"{error:.2g}" if error < 100.0 else f"{error:.0f}" for error in errors)


def diagnosed(
    folder: Path, data: Path, model: str, absent: tuple[str, ...], train: str = "AB"
) -> Found:
    """Of a model without the lines that hold one of the words `absent`."""
    for name in ("kuka_kr300.yaml", "kuka_kr300_columns.yaml", model):
        lines = (MACHINES / name).read_text(encoding="utf-8").splitlines()
        wanted = [line for line in lines if name != model or not any(a in line for a in absent)]
        (folder / name).write_text("\n".join(wanted), encoding="utf-8")
    recordings = {name: data / "kuka_kr300" / f"kuka_{name}.parquet" for name in "ABC"}
    told = [
        *("--model", folder / model, "--columns", folder / "kuka_kr300_columns.yaml"),
        *("--train", *(recordings[name] for name in train), "--validate", recordings["C"]),
        *("--from", 1.8, "--to", 8.2, "--no-average", "--out", folder / "out"),
    ]
    assert main([str(one) for one in told]) == 0
    return Found(json.loads((folder / "out" / "findings.json").read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def best(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Found:
    """With all that the model has: what is left is of the robot."""
    return diagnosed(tmp_path_factory.mktemp("whole"), real_data, MODEL, ())


def test_rotors_left_out_are_named(
    real_data: Path, tmp_path: Path, best: Found, measured: Measured
) -> None:
    """Those of axes 1 and 2 are in the inertia of the bodies, and not claimed."""
    found = diagnosed(tmp_path, real_data, MODEL, ("rotor_inertia",))
    assert found.verdict == "named"
    assert found.alone
    assert found.effects == {("rotor_inertia", axis) for axis in AXES[2:]}
    hidden = {
        (one["effect"], one["joint"])
        for one in found.content["not_testable"]
        if one["reason"].startswith("0.0% of its column")
    }
    assert {("rotor_inertia", axis) for axis in AXES[:2]} <= hidden
    assert found.errors("before")[5] > 15.0
    assert found.errors("after") == pytest.approx(best.errors("before"), abs=0.2)
    found.show(measured, "inertia of the rotors", "named on axes 3 to 6: those of 1, 2 are bodies'")


@pytest.mark.parametrize(
    ("absent", "worst"), [(("coulomb",), 50.0), (("coulomb", "viscous"), 110.0)]
)
def test_friction_left_out_is_named_on_all_axes(
    real_data: Path,
    tmp_path: Path,
    best: Found,
    measured: Measured,
    absent: tuple[str, ...],
    worst: float,
) -> None:
    found = diagnosed(tmp_path, real_data, MODEL, absent)
    assert found.verdict == "named"
    assert found.alone
    assert found.effects == {(kind, axis) for kind in absent for axis in AXES}
    assert max(found.errors("before")) > worst
    assert found.errors("after") == pytest.approx(best.errors("before"), abs=0.4)
    found.show(measured, " and ".join(absent), "named on all axes")


def test_viscous_friction_is_named_where_it_shows(
    real_data: Path, tmp_path: Path, measured: Measured
) -> None:
    """That of axis 3 hardly does beside Coulomb friction: something more is missing there."""
    found = diagnosed(tmp_path, real_data, MODEL, ("viscous",))
    assert found.verdict == "named_and_more"
    assert found.alone
    assert found.effects == {("viscous", axis) for axis in AXES if axis != "axis_3"}
    assert "error of axis_3 rises" in found.content["reason"]
    found.show(measured, "viscous", "named on all axes")


def test_friction_of_one_axis_is_named_on_that_axis(
    real_data: Path, tmp_path: Path, measured: Measured
) -> None:
    found = diagnosed(tmp_path, real_data, MODEL, ("coulomb, joint: axis_2",))
    assert ("coulomb", "axis_2") in found.effects
    assert not {(kind, axis) for kind, axis in found.effects if kind == "coulomb"} - {
        ("coulomb", "axis_2")
    }
    assert found.errors("after")[1] < 0.4 * found.errors("before")[1]
    found.show(measured, "coulomb of axis 2", "named on axis 2")


def test_the_counterbalance_is_weight_as_far_as_recordings_tell(
    real_data: Path, tmp_path: Path, best: Found, measured: Measured
) -> None:
    """With it, the errors are those without; its value is not determined, and not given; what is
    named is not certain enough for both.

    Without it, a force that follows the position of its axis is said to hide behind the weight, and
    is named there in no answer.
    """
    rotors = ("rotor_inertia, joint: axis_1", "rotor_inertia, joint: axis_2")
    found = diagnosed(tmp_path, real_data, WITH_SPRING, rotors)
    assert found.content["undetermined"] == ["gas_spring.axis_2"]
    assert found.effects <= best.effects
    assert found.errors("before") == pytest.approx(best.errors("before"), abs=0.4)
    hidden = {(one["effect"], one["joint"]) for one in best.content["not_testable"]}
    assert ("hose_stiffness", "axis_2") in hidden
    assert "axis_2" not in {axis for _, axis in best.effects}
    best.show(
        measured, "the counterbalance of axis 2", "nothing on axis 2: it is as good as weight"
    )


def test_what_is_left_of_axis_4_is_said_to_be_no_law(best: Found) -> None:
    """Its error is the largest of all, in every fit; neither the catalogue nor a learner has it."""
    errors = best.errors("after")
    assert max(errors) == errors[3]
    assert 10.0 < errors[3] < 20.0
    left = best.content["left"]["axis_4"]
    assert not left["systematic"]
    assert left["learnable_share"] < 0.1


def test_one_recording_alone_names_nothing(real_data: Path, tmp_path: Path) -> None:
    """Its six references span four dimensions."""
    found = diagnosed(tmp_path, real_data, MODEL, (), train="A")
    assert not found.effects
    assert found.content["undetermined"]
