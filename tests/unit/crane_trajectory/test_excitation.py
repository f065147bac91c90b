"""The search (35): its gradients, its limits, its starts, and that a campaign gains information."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from crane_model import ConfigurationError, Model, RangeError, load_machine, load_model
from crane_model.machine_files import machine_file
from crane_model.terms.term import Setting
from crane_trajectory import (
    Clearance,
    FourierTrajectory,
    load_clearance,
    load_design_settings,
    load_trajectory,
)
from crane_trajectory.excitation.criterion import ColumnSet, Criterion, CriterionKind, one_period
from crane_trajectory.excitation.limits import Limit
from crane_trajectory.excitation.search import (
    ExcitationProblem,
    campaign,
    machine_of,
    search,
    steps,
)
from crane_trajectory.motion.check import TipClearance, pump_flow

PLANAR_JOINTS = load_machine().joint_names[1:]
MODEL = load_model(machine_file("model.yaml"))
SETTINGS = load_design_settings(machine_file("design.yaml"))
CLEARANCE = load_clearance(machine_file("clearance.yaml"))
STAGE = SETTINGS.search.explore.model_copy(update={"iterations": 10})
QUICK = SETTINGS.search.model_copy(
    update={"samples": 60, "survivors": 2, "explore": STAGE, "polish": STAGE}
)
PERIOD, HARMONICS = 20.0, 3
ACCELERATION = {"inner_boom": 0.1, "outer_boom": 0.2, "telescope": 0.15}


def problem(kind=CriterionKind.PRODUCT, columns=ColumnSet.BASE, **changes):
    criterion = Criterion.of(MODEL, kind, columns, SETTINGS.experiment, SETTINGS.plausible)
    whole = ExcitationProblem(
        MODEL, criterion, PERIOD, HARMONICS, QUICK, SETTINGS.margins, CLEARANCE
    )
    return replace(whole, **changes)


PROBLEM = problem()


def wild_point(seed):
    """A trajectory far outside all limits."""
    return np.random.default_rng(seed).normal(size=21) * 2.0


@pytest.mark.parametrize("kind", list(CriterionKind))
@pytest.mark.parametrize("columns", list(ColumnSet))
def test_gradient_is_that_of_the_smoothed_criterion(kind, columns):
    given = problem(kind, columns, harmonics=5)  # at a point that is conditioned well enough
    point = load_trajectory(machine_file("excitation_20s.yaml")).coefficients.ravel()
    value, gradient = given.smooth(point, STAGE)
    numeric = np.empty_like(gradient)
    for i, unit in enumerate(np.eye(len(point))):
        near, far = (
            given.smooth(point + step * unit, STAGE)[0]
            - given.smooth(point - step * unit, STAGE)[0]
            for step in (1e-5, 2e-5)
        )
        numeric[i] = (8.0 * near - far) / 12e-5  # fourth order
    assert np.isfinite(value)
    np.testing.assert_allclose(gradient, numeric, atol=1e-4 * np.abs(gradient).max())


def test_slopes_of_flow_and_clearance_are_derivatives():
    limits, step = PROBLEM.start_limits, 1e-6
    point = PROBLEM.random_point(np.random.default_rng(3))
    numeric = [
        (limits.reserves(point + step * unit) - limits.reserves(point - step * unit)) / (2 * step)
        for unit in np.eye(len(point))
    ]
    np.testing.assert_allclose(limits.reserve_slopes(point), np.transpose(numeric), atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_a_start_outside_the_limits_is_mended(seed):
    given = problem(acceleration=ACCELERATION)
    limits, point = given.start_limits, wild_point(seed)
    assert (limits.matrix @ point > limits.bound).any()
    mended = limits.repaired(point)
    assert (limits.matrix @ mended <= limits.bound + 1e-12).all()
    assert (limits.reserves(mended) >= 0.0).all()


def test_a_start_within_the_limits_is_left_alone():
    point = PROBLEM.random_point(np.random.default_rng(2))
    np.testing.assert_allclose(PROBLEM.start_limits.repaired(point), point, atol=1e-12)


def found_from(given, seed):
    return given.polish(given.start_limits.repaired(wild_point(seed)), "found")


@pytest.mark.parametrize("seed", range(2))
def test_found_trajectory_keeps_every_limit_on_a_much_finer_grid(seed):
    found = found_from(problem(acceleration=ACCELERATION), seed)
    assert found.violations == ()
    points = 10 * STAGE.grid_per_harmonic * HARMONICS
    motion = found.trajectory.evaluate(np.arange(points) * PERIOD / points)
    machine = MODEL.machine
    for i, joint in enumerate(PLANAR_JOINTS):
        limits = machine.limits[joint]
        assert limits.position_min <= motion.position[:, i].min()
        assert motion.position[:, i].max() <= limits.position_max
        assert limits.velocity_min <= motion.velocity[:, i].min()
        assert motion.velocity[:, i].max() <= limits.velocity_max
        assert np.abs(motion.acceleration[:, i]).max() <= ACCELERATION[joint]
    flow = pump_flow(machine, PLANAR_JOINTS, motion.position, motion.velocity)
    assert flow.max() <= machine.hydraulics.pump_flow
    distance, height = TipClearance(machine).at(PLANAR_JOINTS, motion.position).T
    assert distance.min() >= CLEARANCE.pillar_clearance
    assert height.min() >= CLEARANCE.lowest_tip


@pytest.mark.parametrize("limit", list(Limit))
def test_a_limit_can_be_left_out(limit):
    given, point = problem(without=frozenset({limit})), wild_point(7)
    free, bound = given.start_limits, PROBLEM.start_limits
    rows = [len(limits.bound) + len(limits.reserves(point)) for limits in (free, bound)]
    assert rows[0] < rows[1]
    assert len(free.reserve_slopes(point)) == len(free.reserves(point))
    assert {v.quantity for v in found_from(given, 7).violations} == set()


def test_the_weak_pump_limits_all_cylinders_together():
    weak = MODEL.machine.model_copy(
        update={"supply": MODEL.machine.hydraulics.model_copy(update={"pump_flow": 2e-4})}
    )
    model = replace(MODEL, setting=Setting(MODEL.setting.units, weak))
    found = found_from(problem(model=model), 1)
    assert found.violations == ()
    motion = found.trajectory.evaluate(np.linspace(0.0, PERIOD, 1000))
    flow = pump_flow(weak, PLANAR_JOINTS, motion.position, motion.velocity)
    assert 1.5e-4 < flow.max() <= 2e-4


def test_search_improves_and_repeats_by_seed():
    ticks = []
    with ThreadPoolExecutor(2) as threads, ThreadPoolExecutor(1) as thread:
        first = search(PROBLEM, 5, 3, "found", threads, lambda: ticks.append(1))
        again = search(PROBLEM, 5, 3, "found", thread)
        reseeded = search(PROBLEM, 6, 3, "found", thread)
    assert len(ticks) == steps(PROBLEM, 3) == 5
    assert [candidate.trajectory for candidate in first] == [x.trajectory for x in again]
    assert first[0].criterion < reseeded[0].criterion or first[0] != reseeded[0]
    starts = [PROBLEM.value(PROBLEM.random_point(np.random.default_rng([5, i]))) for i in range(3)]
    assert first[0].criterion < min(starts) - 1.0
    assert first[0].criterion == min(x.criterion for x in first)


def test_criterion_of_a_candidate_is_that_of_its_published_coefficients():
    found = found_from(PROBLEM, 3)
    phi = one_period(MODEL, found.trajectory, QUICK.samples).reshape(-1, 20)
    product = np.linalg.cond(phi) * np.linalg.cond(phi / np.linalg.norm(phi, axis=0))
    assert found.criterion == pytest.approx(np.log(product), rel=1e-6)


def test_a_campaign_tells_more_than_as_many_copies_of_its_first():
    given = problem(CriterionKind.D_OPTIMALITY)
    with ThreadPoolExecutor(2) as pool:
        found = [x.trajectory for x in campaign(given, ["a", "b"], 1, 6, pool)]
    assert [x.name for x in found] == ["a", "b"]
    first, second = (given.criterion.gram(one_period(MODEL, x, QUICK.samples)) for x in found)
    together, copies = given.criterion.exact(first + second), given.criterion.exact(2.0 * first)
    assert together < copies - 0.015  # every axis of the ellipsoid 1.5 % shorter, on average
    limits = given.start_limits
    for trajectory in found:  # no joint is held still for the sake of the others
        swing = np.ptp(limits.basis.position @ trajectory.coefficients, axis=0)
        assert (swing > 0.1 * (limits.highest - limits.lowest)).all()


def test_no_clearance_for_the_tip_is_refused():
    tall = Clearance(gripper_length=9.0, ground_clearance=0.0, pillar_clearance=0.0)
    with pytest.raises(RangeError, match="no pose within the joint limits"):
        problem(clearance=tall).random_point(np.random.default_rng(0))


def test_another_model_is_refused():
    model = Model("one axis", Setting({"motor": "rad"}, None), MODEL.terms[1:2])
    with pytest.raises(ConfigurationError, match="'one axis'.*got the joints motor and no machine"):
        machine_of(model)


def test_coefficients_and_points_are_the_same_numbers():
    point = PROBLEM.random_point(np.random.default_rng(4))
    trajectory = FourierTrajectory.from_coefficients(
        "point", PERIOD, PLANAR_JOINTS, point.reshape(PROBLEM.shape)
    )
    np.testing.assert_array_equal(trajectory.coefficients.ravel(), point)
