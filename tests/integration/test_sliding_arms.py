"""A SCARA and a gantry, described by YAML alone: parallel axes, slides, axes without gravity."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest

from crane_identification.check_recording import main as check_recording
from crane_identification.diagnose import main as diagnose
from crane_identification.identify import main as identify

GRAVITY = 9.81  # m/s2
STEP = 0.004  # s
PLAUSIBLE_SIGMAS = 4.5


class Axis(NamedTuple):
    """A joint `turns` or slides along `axis`, at `place` [m]; its body and friction, its motion."""

    turns: bool
    place: tuple[float, float, float]
    axis: tuple[float, float, float]
    mass: float  # kg
    centre: tuple[float, float, float]  # m
    inertia: tuple[float, float, float]  # kg m2, about the centre
    middle: float  # rad or m
    swing: float
    dry: float  # N m or N
    viscous: float  # per rad/s or m/s


UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
SCARA = (
    Axis(True, (0, 0, 0.4), UP, 8.0, (0.15, 0.01, 0.02), (0.05, 0.12, 0.13), 0.1, 1.1, 4, 5),
    Axis(True, (0.35, 0, 0), UP, 5.0, (0.12, -0.02, 0), (0.03, 0.07, 0.08), 0.2, 1.2, 2, 2.5),
    Axis(False, (0.3, 0, 0), DOWN, 1.6, (0.01, 0, 0.1), (0.01, 0.01, 0.004), 0.1, 0.08, 6, 20),
    Axis(True, (0, 0, 0), DOWN, 0.9, (0.02, 0.01, 0.05), (0.004, 0.004, 0.002), 0, 1.8, 0.3, 0.2),
)
GANTRY = (
    Axis(False, (0, 0, 1), (1, 0, 0), 60.0, (0, 0.5, 0.1), (9, 2, 10), 0.5, 0.4, 40, 100),
    Axis(False, (0, 0, 0), (0, 1, 0), 25.0, (0.1, 0, 0.1), (1, 1, 1), 0.4, 0.3, 20, 50),
    Axis(False, (0, 0, 0), DOWN, 12.0, (0, 0, 0.2), (0.3, 0.3, 0.1), 0.2, 0.15, 10, 30),
)


def forces(arm: tuple[Axis, ...], q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(n, axes) by Pinocchio, without a file of the suite, and friction."""
    model = pin.Model()
    model.gravity = pin.Motion(np.array([0.0, 0.0, -GRAVITY]), np.zeros(3))
    parent = 0
    for i, axis in enumerate(arm):
        kind = pin.JointModelRevoluteUnaligned if axis.turns else pin.JointModelPrismaticUnaligned
        place = pin.SE3(np.eye(3), np.array(axis.place, dtype=float))
        parent = model.addJoint(parent, kind(np.array(axis.axis)), place, f"axis_{i + 1}")
        centre = np.array(axis.centre, dtype=float)
        body = pin.Inertia(axis.mass, centre, np.diag(axis.inertia))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    data = model.createData()
    bodies = np.array([pin.rnea(model, data, *row).copy() for row in zip(q, v, a, strict=True)])
    dry, viscous = np.array([(axis.dry, axis.viscous) for axis in arm]).T
    return bodies + dry * np.sign(v) + viscous * v


def record(path: Path, arm: tuple[Axis, ...], seed: int) -> None:
    """Twenty seconds of five harmonics, and noise of 2 %."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, STEP)
    middle, swing = np.array([(axis.middle, axis.swing) for axis in arm]).T
    w = 2 * np.pi / 10.0 * np.arange(1, 6)[:, np.newaxis]
    size = rng.uniform(0.4, 1.0, (5, len(arm))) * swing / 2.5
    phase = w * time[:, np.newaxis, np.newaxis] + rng.uniform(0, 2 * np.pi, size.shape)
    q, v = middle + (size * np.sin(phase)).sum(axis=1), (size * w * np.cos(phase)).sum(axis=1)
    force = forces(arm, q, v, -(size * w**2 * np.sin(phase)).sum(axis=1))
    force += 0.02 * force.std(axis=0) * rng.standard_normal(force.shape)
    q += 1e-5 * rng.standard_normal(q.shape)
    names = [f"{kind}_{i}" for kind in "qf" for i in range(1, len(arm) + 1)]
    rows = np.column_stack([time, q, force])
    np.savetxt(path, rows, "%.6f", delimiter=",", header=",".join(["t", *names]), comments="")


def describe(folder: Path, arm: tuple[Axis, ...], extra: tuple[str, ...] = ()) -> list[str]:
    """The files of an arm, and the options that name them."""
    machine = [f"name: arm\ngravity: {GRAVITY}\njoints:"]
    columns, units = ["time: {column: t, unit: s}\njoints:"], []
    terms = ["  - {type: serial_rigid_body}"]
    for i, axis in enumerate(arm, 1):
        unit, force = ("rad", "N m") if axis.turns else ("m", "N")
        machine.append(
            f"  - name: axis_{i}\n    kind: {'revolute' if axis.turns else 'prismatic'}\n"
            f"    origin: {{xyz: {list(axis.place)}}}\n    axis: {list(axis.axis)}\n"
            "    limits: {position_min: -3, position_max: 3, velocity_min: -9, velocity_max: 9}\n"
            "    actuator: {type: electric_drive, gear_ratio: 80.0, rotor_inertia: 1.0e-5}"
        )
        columns.append(
            f"  axis_{i}: {{position: {{column: q_{i}, unit: {unit}}}, "
            f"force: {{column: f_{i}, unit: {force}}}}}"
        )
        units.append(f"axis_{i}: {unit}")
        terms += [f"  - {{type: {kind}, joint: axis_{i}}}" for kind in ("coulomb", "viscous")]
    head = f"name: arm\nmachine: machine.yaml\njoints: {{{', '.join(units)}}}\nterms:"
    (folder / "machine.yaml").write_text("\n".join(machine))
    (folder / "columns.yaml").write_text("\n".join(columns))
    (folder / "model.yaml").write_text("\n".join([head, *terms, *extra]))
    for name, seed in (("train", 1), ("held_out", 2)):
        record(folder / f"{name}.csv", arm, seed)
    return ["--model", str(folder / "model.yaml"), "--columns", str(folder / "columns.yaml")]


def about_axis(axis: Axis) -> float:
    """Inertia about the vertical through the place of a joint [kg m2]."""
    return axis.inertia[2] + axis.mass * (axis.centre[0] ** 2 + axis.centre[1] ** 2)


def expected(arm: tuple[Axis, ...]) -> dict[str, float]:
    """What the motion determines, by hand: nothing lifts the vertical axes but the slide."""
    if arm is GANTRY:
        bodies = {f"m.axis_{i}": axis.mass for i, axis in enumerate(arm, 1)}
    else:
        shoulder, elbow, slide, wrist = arm
        moment = np.array(
            [elbow.mass * elbow.centre[k] + slide.mass * slide.centre[k] for k in (0, 1)]
        )
        along = slide.place[0]
        bodies = {
            "Izz_r.axis_1": about_axis(shoulder) + elbow.place[0] ** 2 * elbow.mass,
            "mx_r.axis_2": moment[0],
            "my_r.axis_2": moment[1],
            "Izz_r.axis_2": about_axis(elbow)
            + about_axis(slide)
            + 2 * along * slide.mass * slide.centre[0],
            "m_r.axis_3": slide.mass + wrist.mass,
            "mx.axis_4": wrist.mass * wrist.centre[0],
            "my.axis_4": wrist.mass * wrist.centre[1],
            "Izz.axis_4": about_axis(wrist),
        }
    friction = {f"f_c.axis_{i}": axis.dry for i, axis in enumerate(arm, 1)}
    return bodies | friction | {f"f_v.axis_{i}": axis.viscous for i, axis in enumerate(arm, 1)}


@pytest.mark.parametrize("arm", [SCARA, GANTRY], ids=["scara", "gantry"])
def test_parameters_are_found_under_names_that_say_what_they_are(
    arm: tuple[Axis, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = describe(tmp_path, arm)
    train, held_out = (str(tmp_path / f"{name}.csv") for name in ("train", "held_out"))
    assert check_recording([*options, train, held_out]) == 0
    assert capsys.readouterr().out.count("looks right") == 2
    recordings = ["--train", train, "--validate", held_out]
    assert identify([*options, *recordings, "--out", str(tmp_path / "fit")]) == 0
    summary = json.loads((tmp_path / "fit" / "summary.json").read_text())
    found = {one["name"]: (one["value"], one["std_dev"]) for one in summary["parameters"]}
    assert found.keys() == expected(arm).keys()
    for name, truth in expected(arm).items():
        value, sigma = found[name]
        assert abs(value - truth) < PLAUSIBLE_SIGMAS * sigma, f"{name}: {value} ± {sigma}, {truth}"
    assert max(summary["heldout_relative_error"].values()) < 0.005


def test_one_effort_in_amperes_is_told_though_the_slide_shares_no_parameter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the slide any unit would fit, and the wrist hardly tells its own."""
    options, train = describe(tmp_path, SCARA), tmp_path / "train.csv"
    names, *lines = train.read_text().splitlines()
    rows = np.loadtxt(lines, delimiter=",")
    rows[:, names.split(",").index("f_1")] /= 7.0
    np.savetxt(train, rows, "%.6f", delimiter=",", header=names, comments="")
    assert check_recording([*options, str(train)]) == 1
    told = capsys.readouterr().out.partition("factors that agree: axis 1 ")[2]
    shoulder, elbow = told.split(", ")[:2]
    ratio = float(shoulder) / float(elbow.removeprefix("axis 2 "))
    assert ratio == pytest.approx(7.0, rel=0.1)


def test_nothing_is_missing_on_a_gantry(tmp_path: Path) -> None:
    options = describe(tmp_path, GANTRY)
    recordings = [
        "--train",
        str(tmp_path / "train.csv"),
        "--validate",
        str(tmp_path / "held_out.csv"),
    ]
    assert diagnose([*options, *recordings, "--out", str(tmp_path / "answer")]) == 0
    answer = json.loads((tmp_path / "answer" / "findings.json").read_text())
    assert answer["verdict"] == "none"


def test_what_no_motion_separates_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The rotor of a slide moves as its mass does, and gravity pulls as an offset does."""
    extra = ("  - {type: rotor_inertia, joint: axis_1}", "  - {type: offset, joint: axis_3}")
    options = describe(tmp_path, SCARA, extra)
    train = str(tmp_path / "train.csv")
    assert check_recording([*options, train]) == 0
    assert identify([*options, "--train", train, "--out", str(tmp_path / "fit")]) == 1
    told = capsys.readouterr().err
    assert "Izz_r.axis_1 + 6400 I_rotor.axis_1" in told and "no other motion helps" in told
    assert "offset" not in told  # the slide accelerates, too
