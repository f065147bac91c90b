"""The search (35): its limits, its gradients, and that it improves what it starts from."""

import numpy as np
import pytest

from crane_model.configuration import packaged
from crane_model.errors import ConfigurationError
from crane_model.machine import PLANAR_JOINTS
from crane_model.model_file import Model, load_model
from crane_model.terms.term import Setting
from crane_trajectory.check import load_clearance, trajectory_violations
from crane_trajectory.excitation import (
    ExcitationProblem,
    forward_difference,
    load_design_settings,
    planar_machine,
)
from crane_trajectory.fourier import FourierTrajectory
from crane_trajectory.merit import figures_of_merit

MODEL = load_model(packaged("crane_model", "crane_model.yaml"))
SETTINGS = load_design_settings()
QUICK = SETTINGS.search.model_copy(update={"iterations": 8, "samples": 60})
PROBLEM = ExcitationProblem(MODEL, 20.0, 3, QUICK, load_clearance())


def trajectory_of(point):
    coefficients = point.reshape(PROBLEM.shape)
    return FourierTrajectory.from_coefficients("point", 20.0, PLANAR_JOINTS, coefficients)


def linear_reserve(point):
    return PROBLEM.bound - PROBLEM.matrix @ point


def test_criterion_is_the_log_of_the_published_condition_numbers():
    point = PROBLEM.random_point(np.random.default_rng(1))
    merit = figures_of_merit(
        MODEL, trajectory_of(point), 60, SETTINGS.experiment, SETTINGS.plausible
    )
    product = merit["condition_number"] * merit["condition_number_normalised"]
    assert PROBLEM.criterion(point[None], smooth=False)[0] == pytest.approx(np.log(product))


def test_many_points_at_once_are_as_one_by_one():
    rng = np.random.default_rng(2)
    points = np.stack([PROBLEM.random_point(rng) for _ in range(4)])
    for function in (PROBLEM.criterion, PROBLEM.reserves):
        single = np.concatenate([function(point[None]) for point in points])
        np.testing.assert_allclose(function(points), single, rtol=1e-9)


def test_differences_are_gradients():
    def quadratic(points):
        return np.stack([(points**2).sum(axis=1), points @ [1.0, 2.0, 3.0]], axis=1)

    point = np.array([0.5, -1.0, 2.0])
    np.testing.assert_allclose(
        forward_difference(quadratic, point), [2 * point, [1.0, 2.0, 3.0]], atol=1e-5
    )


@pytest.mark.parametrize("seed", range(5))
def test_random_points_keep_table_2(seed):
    assert linear_reserve(PROBLEM.random_point(np.random.default_rng(seed))).min() > 0.0


def test_what_meets_the_constraints_passes_the_check():
    """The constraints hold on a coarse grid with margins; the check is exact and without."""
    meets, passes = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        point = PROBLEM.random_point(rng) * rng.uniform(0.8, 2.0)
        reserve = min(linear_reserve(point).min(), PROBLEM.reserves(point[None]).min())
        found = trajectory_violations(MODEL.machine, trajectory_of(point), PROBLEM.clearance)
        meets.append(reserve >= 0.0)
        passes.append(not found)
    assert 0 < sum(meets) < len(meets)
    assert not any(met and not passed for met, passed in zip(meets, passes, strict=True))


def test_a_reference_at_the_constraints_uses_table_2_up_to_the_margins():
    point = PROBLEM.random_point(np.random.default_rng(3)).reshape(PROBLEM.shape)
    offset = point[0].copy()
    low, high = 0.5, 3.0
    for _ in range(60):  # the largest amplitude that the linear constraints allow
        middle = (low + high) / 2
        scaled = np.vstack([offset, middle * point[1:]])
        low, high = (middle, high) if linear_reserve(scaled.ravel()).min() >= 0 else (low, middle)
    motion = trajectory_of(np.vstack([offset, low * point[1:]])).evaluate(np.linspace(0, 20, 4001))
    shares = []
    for i, joint in enumerate(PLANAR_JOINTS):
        limits = MODEL.machine.limits[joint]
        shares += [
            motion.velocity[:, i].max() / limits.velocity_max,
            motion.velocity[:, i].min() / limits.velocity_min,
        ]
        half = (limits.position_max - limits.position_min) / 2
        shares.append(np.abs(motion.position[:, i] - limits.position_min - half).max() / half)
    assert 0.9 < max(shares) < 0.97


def test_search_improves_its_start_and_repeats():
    start = PROBLEM.random_point(np.random.default_rng([5, 0]))
    first = PROBLEM.minimise(np.random.default_rng([5, 0]), "found")
    again = PROBLEM.minimise(np.random.default_rng([5, 0]), "found")
    assert first.criterion < PROBLEM.criterion(start[None], smooth=False)[0] - 1.0
    assert first.trajectory == again.trajectory
    assert first.trajectory.joint_names == PLANAR_JOINTS
    found = trajectory_violations(MODEL.machine, first.trajectory, PROBLEM.clearance)
    assert first.within_limits == (not found)


def test_another_model_is_refused():
    model = Model("one axis", Setting({"motor": "rad"}, None), MODEL.terms[1:2])
    with pytest.raises(ConfigurationError, match="'one axis'.*got the joints motor and no machine"):
        planar_machine(model)
