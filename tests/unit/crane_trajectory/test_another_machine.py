"""A made-up machine of two joints, a carriage [m] and an arm [rad], whose files name the arm first:
trajectories, controller, experiment and design follow the machine.
"""

from pathlib import Path

import numpy as np
import pytest

from crane_model import (
    ConfigurationError,
    Machine,
    RangeError,
    load_machine,
    load_model,
    tip_jacobian,
)
from crane_model.machine_files import machine_file
from crane_trajectory import (
    Experiment,
    Outcome,
    load_clearance,
    load_design_settings,
    load_trajectory,
    plan,
)
from crane_trajectory.control.controller import Tuning, command, load_gains
from crane_trajectory.excitation.criterion import ColumnSet, Criterion, CriterionKind
from crane_trajectory.excitation.search import ExcitationProblem
from crane_trajectory.excitation.sweeps import design_sweeps
from crane_trajectory.motion.check import TipClearance, draw, trajectory_violations
from crane_trajectory.trajectory_topics import TuningNumbers

LOADER = Path(__file__).parents[2] / "machines" / "loader"
MACHINE = load_machine(LOADER)
CLEARANCE = load_clearance(LOADER / "clearance.yaml")
SLOW = load_trajectory(machine_file("", LOADER, "slow"))
START = np.array([0.4, 0.1])


def test_gains_are_in_the_order_of_the_machine() -> None:
    gains = load_gains(LOADER / "controller.yaml", MACHINE).arrays
    assert gains.kp.tolist() == [8.0, 4.0]
    with pytest.raises(RangeError, match=r"arm: velocity must be finite, got nan rad/s"):
        command(gains, START, np.array([0.0, np.nan]), START, START, MACHINE.units)
    with pytest.raises(ConfigurationError, match="no entry for carriage, arm and no joint slew"):
        load_gains(machine_file("controller.yaml"), MACHINE)


def test_an_experiment_leads_both_joints_through_the_trajectory() -> None:
    gains = load_gains(LOADER / "controller.yaml", MACHINE).arrays
    motion = plan(MACHINE, SLOW, START, 1, CLEARANCE)
    middle = motion.reference(np.array([motion.excitation_start + 3.0])).position[0]
    arm, carriage = SLOW.evaluate(np.array([3.0])).position[0]
    assert middle == pytest.approx([carriage, arm])
    tuning, now = Tuning(gains, 1.0, np.array([0.1, 0.2])), 10.0
    experiment = Experiment(motion, tuning, 0.06, now)
    q, v = START.copy(), np.zeros(2)
    while not experiment.over:
        now += 0.01
        u = experiment.sample(now, q, v, now)
        if u is not None:
            v = np.sign(u) * np.maximum(np.abs(u) - 0.05, 0.0)
        q = q + 0.01 * v
    assert experiment.outcome is Outcome.COMPLETED
    assert experiment.rms.shape == (2,)
    assert (experiment.rms < 0.05).all()


def test_limits_are_told_with_joint_and_unit() -> None:
    joints = {"arm": {"offset": 0.2, "sine": [2.0], "cosine": [0.0]}}
    fast = type(SLOW).model_validate({"name": "fast", "period": 10.0, "joints": joints})
    (first, *_) = trajectory_violations(MACHINE, fast, CLEARANCE)
    assert str(first).startswith("arm: position 2.2 rad at t = ")


def test_a_trajectory_of_a_crane_is_refused() -> None:
    shipped = load_trajectory(machine_file("excitation_20s.yaml"))
    told = r"no joint inner_boom, outer_boom, telescope; test loader has the joints carriage, arm"
    for refused in (
        lambda: plan(MACHINE, shipped, START, 1, CLEARANCE),
        lambda: trajectory_violations(MACHINE, shipped, CLEARANCE),
    ):
        with pytest.raises(RangeError, match=told):
            refused()


@pytest.mark.parametrize("machine", [LOADER, "excavator", "single_axis", "laboratory_crane"])
def test_the_slopes_of_the_clearance_are_its_derivatives(machine: Path | str) -> None:
    loaded = load_machine(machine)
    tip_clearance, joints = TipClearance(loaded), tuple(reversed(loaded.joint_names))
    rng = np.random.default_rng(3)
    limits = [loaded.limits[joint] for joint in joints]
    q = rng.uniform(
        [limit.position_min for limit in limits],
        [limit.position_max for limit in limits],
        (20, len(joints)),
    )
    slopes = tip_clearance.slopes(joints, q)
    for j in range(len(joints)):
        step = np.zeros(len(joints))
        step[j] = 1e-6
        numeric = (tip_clearance.at(joints, q + step) - tip_clearance.at(joints, q - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, :, j], numeric, atol=1e-8)


def test_a_swing_about_the_vertical_costs_no_clearance() -> None:
    excavator = load_machine("excavator")
    assert TipClearance(excavator).joints == excavator.joint_names[1:]
    assert TipClearance(MACHINE).joints == MACHINE.joint_names
    pose = np.array([[0.5, 0.3]])
    distance, height = TipClearance(MACHINE).at(MACHINE.joint_names, pose)[0]
    assert distance == pytest.approx(0.5 + 0.3 + 1.5 * np.cos(0.3))
    assert height == pytest.approx(1.0 + 1.5 * np.sin(0.3))
    assert tip_jacobian(MACHINE, pose).shape == (1, 3, 2)


def problem(machine: Path) -> ExcitationProblem:
    settings = load_design_settings(machine_file("design.yaml", machine))
    model = load_model(machine_file("model.yaml", machine))
    criterion = Criterion.of(
        model, CriterionKind.PRODUCT, ColumnSet.BASE, settings.experiment, settings.plausible
    )
    return ExcitationProblem(
        model, criterion, 10.0, 2, settings.search, settings.margins, CLEARANCE
    )


def test_a_search_starts_within_the_limits_and_knows_its_gradient() -> None:
    given = problem(LOADER)
    point = given.random_point(np.random.default_rng(1))
    assert not given.check(given.fitted(point, "start").trajectory)
    stage = given.search.explore
    value, slope = given.smooth(point, stage)
    assert np.isfinite(value)
    way = np.random.default_rng(2).standard_normal(point.shape)
    far, near = (
        (given.smooth(point + h * way, stage)[0] - given.smooth(point - h * way, stage)[0])
        / (2 * h)
        for h in (2e-5, 1e-5)
    )
    assert slope @ way == pytest.approx((4.0 * near - far) / 3.0, rel=1e-4)
    limits = given.limits(8)
    reserve = limits.reserves(point)
    assert len(reserve) == 2 * 8 * 2, "pump flow and height; the pillar keeps nothing free"
    np.testing.assert_allclose(
        limits.reserve_slopes(point) @ way,
        (limits.reserves(point + 1e-7 * way) - limits.reserves(point - 1e-7 * way)) / 2e-7,
        atol=1e-5,
    )


def test_sweeps_are_of_the_joints_of_the_model(tmp_path: Path) -> None:
    margins = load_design_settings(LOADER / "design.yaml").margins
    sweeps = design_sweeps(MACHINE, ("carriage", "arm"), CLEARANCE, margins, [0.9], 0.2, "both")
    assert sweeps.joint_names == ("carriage", "arm")
    assert not trajectory_violations(MACHINE, sweeps, CLEARANCE)
    draw(tmp_path / "sweeps.png", MACHINE, sweeps, CLEARANCE)
    assert (tmp_path / "sweeps.png").stat().st_size > 10_000
    with pytest.raises(ConfigurationError, match="depends on carriage, arm, but .* only arm"):
        design_sweeps(MACHINE, ("arm",), CLEARANCE, margins, [0.5], 1.0, "one")


def test_a_machine_without_hydraulics_has_no_flow_to_keep(tmp_path: Path) -> None:
    text = (LOADER / "machine.yaml").read_text().split("hydraulics:")[0]
    start, end = text.index("    actuator:\n      type: direct"), text.index("  - name: arm")
    text = text[:start] + "    actuator: {type: electric_drive, gear_ratio: 20.0}\n" + text[end:]
    (tmp_path / "machine.yaml").write_text(text)
    electric: Machine = load_machine(tmp_path)
    assert not electric.cylinders
    assert plan(electric, SLOW, START, 1, CLEARANCE).duration > 5.0


def test_the_parameters_of_the_tuning_are_those_of_the_joints() -> None:
    numbers = TuningNumbers.of(MACHINE, str(LOADER))
    assert {number.name: number.unit for number in numbers.tolerances.values()} == {
        "tracking_tolerance.carriage": "m",
        "tracking_tolerance.arm": "rad",
    }
    tuning = numbers.tuning({number.name: number.default for number in numbers.all})
    assert tuning.tolerance.tolist() == [0.1, 0.2]
    assert tuning.gains.kp.tolist() == [8.0, 4.0]
