"""The scale: its windows, its balance beside MuJoCo's, a machine at work, lost readings."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_observer.observed import JOINTS, MACHINE, at_work, known, recording
from unit.crane_observer.payload.made_windows import shaken

from crane_model import ConfigurationError, load_model, tip_position
from crane_model.machine_files import machine_file
from crane_observer import HeardRecording
from crane_observer.payload.estimator import (
    BEND_NOISE,
    LEVEL_NOISE,
    WORST_SHARE,
    HeldReadings,
    Lift,
    LiftLog,
    PayloadCondition,
    PayloadEstimate,
    PayloadEstimator,
    lift_of,
    lifts,
    means,
    noise_of_mean,
    replay,
)
from crane_observer.payload.filter import (
    Balanced,
    LoadFilter,
    MeanMotion,
    ModelDoubt,
    TipMechanics,
    attainable,
    load_of,
)
from crane_observer.payload.hypotheses import LoadHypotheses
from crane_observer.position.state import heaviest_load
from crane_sim import load_simulated_crane
from crane_sim.parts.mujoco_model import add_body, chain_positions, link_name, machine_spec

UNWEIGHED = (PayloadCondition.PRESSURES_LOST, PayloadCondition.POSITIONS_LOST)


def weighed(given_: HeardRecording | None = None, tared: float = math.nan) -> list[PayloadEstimate]:
    return replay(PayloadEstimator(known()), given_ or recording(), tared)


def carried(found: list[PayloadEstimate]) -> np.ndarray:
    """(n,) kg at the middle of the windows."""
    made, load = at_work()
    return np.interp([estimate.time - 0.15 for estimate in found], made.time - made.time[0], load)


def unchanged(found: list[PayloadEstimate], seconds: float = 2.0) -> np.ndarray:
    """(n,) whether what hangs there has done so for that long."""
    made, load = at_work()
    time = made.time - made.time[0]
    return np.array(
        [
            np.ptp(load[(time > estimate.time - seconds) & (time <= estimate.time)]) == 0.0
            for estimate in found
        ]
    )


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_noise_of_a_window_is_known_from_its_readings(rate: float) -> None:
    """Against the scatter of many windows, on top of a motion of which each knows nothing."""
    rng, half = np.random.default_rng(1), 0.15
    time = np.arange(0.0, 2.0 * half, 1.0 / rate)
    motion = np.sin(2.0 * time) + 0.5 * time**3
    found, told = [], []
    for _ in range(600):
        shown = (motion + 0.01 * rng.standard_normal(len(time)))[:, np.newaxis]
        found.append(means(time, shown, 0.0, 2.0 * half)[:, 0])
        told.append(noise_of_mean(time, shown, 0.0, 2.0 * half)[0, 0])
    scatter, noise = np.std(found, axis=0), np.sqrt(np.mean(told))
    assert LEVEL_NOISE * noise == pytest.approx(scatter[0], rel=0.1)
    assert BEND_NOISE * noise / half**2 == pytest.approx(scatter[2], rel=0.15)


def test_the_heaviest_load_is_what_the_drives_hold_by_virtual_work() -> None:
    """A kilogram that rises with the tip, against a piston at supply pressure, in many poses."""
    heaviest, rng = heaviest_load(MACHINE, JOINTS), np.random.default_rng(2)
    limits = [MACHINE.limits[joint] for joint in MACHINE.joint_names]
    poses = rng.uniform(
        [limit.position_min for limit in limits],
        [limit.position_max for limit in limits],
        (4000, len(limits)),
    )
    nudge, held = 1e-5, np.full(len(poses), np.inf)
    for joint in JOINTS:
        i, step = MACHINE.index(joint), np.zeros(len(limits))
        step[i] = nudge
        up, down = (tip_position(MACHINE, poses + sign * step)[:, 2] for sign in (1.0, -1.0))
        length = [MACHINE.cylinder(joint, (poses + sign * step)[:, i])[:, 0] for sign in (1.0, -1)]
        work = 9.81 * (up - down) / (length[0] - length[1])  # N on the piston for 1 kg
        actuator = MACHINE.cylinders[joint]
        area = np.where(work > 0.0, actuator.area_a, actuator.area_b)
        held = np.minimum(held, area * MACHINE.hydraulics.supply_pressure / np.abs(work))
    assert heaviest == pytest.approx(held.min(), rel=0.1)
    assert ModelDoubt.of(known()).unknown == pytest.approx(0.77 * heaviest)


def test_noise_of_accelerations_makes_no_load_lighter() -> None:
    """It is in the inertial forces of machine and load alike: errors in the variables."""
    doubt = ModelDoubt(dry=1e-4, viscous=1e-4, carried=1e-4, crawl=1e-4, zero=1.0, slow=1.0)
    rng, load, errors = np.random.default_rng(4), 80.0, []
    for _ in range(20):
        told = LoadFilter(doubt, 3)
        for _ in range(200):
            told.take(shaken(load, 0.3, rng))
        errors.append(load_of(told.x, told.P).mass - load)
    assert abs(np.mean(errors)) < 3.0 * np.std(errors) / math.sqrt(len(errors))


def test_a_load_adds_its_inertia() -> None:
    """Columns of the inertia of 1 kg at the tip, from the Jacobian of the tip."""
    pose, nudge = np.array([0.3, -0.3, 0.5]), 1e-5
    whole = np.zeros(len(MACHINE.joint_names))
    columns = [MACHINE.index(joint) for joint in JOINTS]
    whole[columns] = pose
    steps = nudge * np.eye(len(whole))[columns]
    jacobian = (tip_position(MACHINE, whole + steps) - tip_position(MACHINE, whole - steps)).T
    jacobian /= 2.0 * nudge
    pressures = np.full(3, 5e6)
    still = MeanMotion(pose, np.zeros(3), np.zeros(3), pressures, pressures)
    balance = TipMechanics.of(known()).balance(still)
    np.testing.assert_allclose(balance.inertia_of_load[0], jacobian.T @ jacobian, atol=1e-6)
    accelerated = TipMechanics.of(known()).balance(still._replace(acceleration=np.ones(3)))
    np.testing.assert_allclose(balance.inertia.sum(axis=1), accelerated.inertial, rtol=1e-6)


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.floats(-50.0, 50.0),
    st.integers(0, 1000),
)
def test_means_of_a_parabola_are_exact_and_fit_each_other(
    c: list[float], offset: float, seed: int
) -> None:
    jitter = np.random.default_rng(seed).uniform(-1e-4, 1e-4, 81)
    time = offset + 0.005 * np.arange(81) + jitter
    s = time - offset
    values = (c[0] + c[1] * s + c[2] * s**2)[:, np.newaxis]
    level, rate, bend = means(time, values, offset + 0.05, offset + 0.35)[:, 0]
    # the second moment of (1 - s^2)^3 over its area is 1/9
    assert level == pytest.approx(c[0] + 0.2 * c[1] + c[2] * (0.04 + 0.15**2 / 9.0), abs=1e-4)
    assert rate == pytest.approx(c[1] + 0.4 * c[2], abs=5e-3)
    assert bend == pytest.approx(2.0 * c[2], abs=5e-2)


def test_a_window_with_a_hole_has_no_mean() -> None:
    time = np.delete(0.005 * np.arange(61), slice(20, 40))
    values = np.stack([time, np.where(time < 1.0, np.nan, 0.0)], axis=1)
    assert np.isnan(means(time, values, 0.0, 0.3)).all()


def test_late_readings_are_left_out_and_counted() -> None:
    readings = HeldReadings(1)
    for time in (0.0, 1.0, 0.5, 1.0, 2.0):
        readings.add(time, np.array([np.nan if time == 2.0 else time]))
    assert readings.held[0].tolist() == [0.0, 1.0, 2.0]
    assert (readings.late, readings.invalid) == (2, 1)


def by_mujoco(
    q: np.ndarray, v: np.ndarray, a: np.ndarray, mass: float, centre: float
) -> np.ndarray:
    """(3,) what the simulated bodies ask of the joints of the model, with a load at the tip."""
    machine = known().machine
    assert machine is not None
    spec = machine_spec(load_simulated_crane(), machine)
    load = add_body(spec.body(link_name(machine.joints[-1].name)), "load", np.eye(4))
    load.ipos = 0.0, 0.0, centre  # the telescope slides along z
    load.mass, load.inertia, load.explicitinertial = mass, np.full(3, 1e-9), True
    model = spec.compile()
    data = mujoco.MjData(model)
    for field, values in ((data.qpos, q), (data.qvel, v), (data.qacc, a)):
        field[:] = chain_positions(machine, np.concatenate([[0.0], values]))
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse[1:])


@given(st.integers(0, 10**6), st.floats(-0.4, 0.4))
@settings(max_examples=15)
def test_a_load_asks_what_mujoco_says(seed: int, centre: float) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform([-0.3, -2.3, 0.1], [1.2, -0.3, 1.4])
    v, a = rng.uniform(-0.4, 0.4, 3), rng.uniform(-1.0, 1.0, 3)
    pressures = np.full(3, 5e6)
    balance = TipMechanics.of(known()).balance(MeanMotion(q, v, a, pressures, pressures))
    tiny = 1e-6  # kg, in place of none
    step = 1e-3  # m, for the slope against the centre of a load, in which h_s is linear
    bare = by_mujoco(q, v, a, tiny, 0.0)
    mass = by_mujoco(q, v, a, 100.0, 0.0) - bare
    assert 100.0 * balance.mass == pytest.approx(mass, rel=1e-5, abs=1e-3)
    beyond, before = (by_mujoco(q, v, a, 100.0, c) for c in (step, -step))
    assert balance.moment == pytest.approx((beyond - before) / (200.0 * step), rel=1e-4, abs=1e-4)
    # what h_s leaves out, the inertia of the way itself, is small beside a load
    far = by_mujoco(q, v, a, 100.0, centre) - bare
    left = np.abs(far - 100.0 * (balance.mass + centre * balance.moment))
    assert (left < 100.0 * centre**2 * (np.abs(v).sum() ** 2 + np.abs(a).sum()) + 1e-2).all()


def test_a_load_is_weighed_in_motion_and_its_interval_covers_it() -> None:
    found = weighed()
    load = carried(found)
    settled = np.array(
        [estimate.moved > 1.0 and estimate.condition is PayloadCondition.GOOD for estimate in found]
    )
    settled &= unchanged(found)
    error = np.array([estimate.load.mass for estimate in found]) - load
    deviation = np.array([estimate.load.deviation for estimate in found])
    assert settled.sum() > 20
    assert np.abs(error[settled]).max() < 2.0
    assert (np.abs(error) < 3.0 * deviation)[settled].mean() > 0.9


def test_a_load_that_comes_is_noticed_and_stands_in_the_log() -> None:
    found = weighed()
    load = carried(found)
    (first, *_) = lifts(found)
    came = found[int(np.flatnonzero(load > 0.0)[0])].time
    assert abs(first.picked_up - came) < 0.7
    assert first.load.mass == pytest.approx(load[load > 0.0][0], rel=0.03)


def test_before_it_is_sure_of_another_load_it_is_sure_of_none() -> None:
    found = weighed()
    load = carried(found)
    noticed = [k for k, estimate in enumerate(found) if estimate.changed]
    assert noticed
    for k in noticed:
        before = found[k - 1].load
        assert abs(before.mass - load[k - 1]) < 3.0 * before.deviation


def test_a_tare_makes_what_hangs_there_nothing() -> None:
    made, load = at_work()
    at = float(made.time[np.flatnonzero(load > 0.0)[0]] - made.time[0]) + 2.5
    found = weighed(tared=at)
    assert not lifts([estimate for estimate in found if at < estimate.time < at + 0.5])
    after = [estimate for estimate, kg in zip(found, carried(found), strict=True)
             if estimate.time > at + 2.0 and kg == 0.0 and estimate.moved > 1.5]  # fmt: skip
    tared = float(load[load > 0.0][0])
    assert after and after[-1].load.mass == pytest.approx(-tared, rel=0.03)


@pytest.mark.parametrize("lost", ["pressures", "encoders"])
def test_lost_readings_are_named_and_it_recovers(lost: str) -> None:
    whole = recording()
    begin, end = 4.0, 5.0
    if lost == "pressures":
        out = (whole.pressure_time > begin) & (whole.pressure_time < end)
        given_ = replace(whole, chamber_a=np.where(out[:, np.newaxis], np.nan, whole.chamber_a))
    else:
        out = (whole.encoder_time > begin) & (whole.encoder_time < end)
        given_ = replace(whole, encoders=np.where(out[:, np.newaxis], np.nan, whole.encoders))
    found = weighed(given_)
    expected = PayloadCondition[f"{'PRESSURES' if lost == 'pressures' else 'POSITIONS'}_LOST"]
    told = {estimate.condition for estimate in found if begin + 0.35 < estimate.time < end}
    assert told == {expected}
    after = [estimate for estimate in found if estimate.time > end + 0.4]
    assert not {estimate.condition for estimate in after} & set(UNWEIGHED)
    assert abs(after[2].load.mass) < 3.0 * after[2].load.deviation


def test_one_lost_transducer_is_named_rather_than_guessed() -> None:
    chamber_b = recording().chamber_b.copy()
    chamber_b[:, 1] = np.nan
    found = weighed(replace(recording(), chamber_b=chamber_b))
    assert {estimate.condition for estimate in found} == {PayloadCondition.PRESSURES_LOST}
    assert not lifts(found)


@pytest.mark.parametrize("wrong", [-6e-3, 6e-3])
def test_a_wrong_estimate_of_a_position_is_no_load(wrong: float) -> None:
    """It is wrong all the while, and not anew in each window: a mean does not mend it."""
    whole, scale, lost, found = recording(), PayloadEstimator(known()), 4.5, []
    rate = np.gradient(whole.encoders, whole.encoder_time, axis=0)
    rate = np.stack(
        [np.convolve(column, np.full(41, 1.0 / 41.0), "same") for column in rate.T], axis=1
    )
    deviation = np.array([0.0, 4e-3, 0.0])
    for k, time in enumerate(whole.pressure_time.tolist()):
        measured = whole.encoders[k].copy()
        if time > lost:
            estimate = whole.encoders[k] + wrong * np.sign(deviation)
            scale.add_estimate(time, estimate, rate[k], deviation)
            measured[1] = np.nan
        scale.add_encoders(time, measured)
        found += scale.add_pressures(time, whole.chamber_a[k], whole.chamber_b[k])
    end = 23.0  # s; a load that comes then is not moved any more
    late = unchanged(found)
    late &= np.array(
        [lost + 0.5 < estimate.time < end and estimate.moved > 1.0 for estimate in found]
    )
    error = np.array([estimate.load.mass for estimate in found]) - carried(found)
    deviations = np.array([estimate.load.deviation for estimate in found])
    assert late.sum() > 40
    assert (np.abs(error) < 3.0 * deviations)[late].mean() > 0.95


def test_only_a_joint_that_hardly_moves_counts_as_about_to_stop(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ends, crawling = [], []

    def spy(histories: LoadHypotheses, end: float, window: Balanced) -> bool:
        ends.append(end)
        crawling.append(window.crawling)
        return False

    monkeypatch.setattr(LoadHypotheses, "add", spy)
    weighed()
    made, _ = at_work()
    time = made.time - made.time[0]
    true = made.truth.position[:, [MACHINE.index(joint) for joint in JOINTS]].T
    begun, ended = (
        [np.interp(np.array(ends) - ago, time, position) for position in true] for ago in (0.3, 0)
    )
    speed = np.abs(np.subtract(ended, begun)).T / 0.3
    share, near = speed / [0.16, 0.39, 0.4], np.array(crawling)  # of the fastest that each may move
    assert near[share < 0.001].min() > 0.8
    assert near[share > 0.2].max() < 0.02
    assert (share < 0.001).any(axis=0).all() and (share > 0.2).any(axis=0).all()


def test_where_even_the_best_weighing_is_bad_it_says_so() -> None:
    found = replay(PayloadEstimator(known(), ModelDoubt(slow=50e5)), recording())
    assert {estimate.condition for estimate in found} == {PayloadCondition.UNOBSERVABLE}


@pytest.mark.parametrize(
    ("joint", "pose", "permitted"),
    [
        (0, (0.3, -1.3, 0.5), True),
        (2, (0.3, -0.3, 0.5), False),  # the telescope lies, and carries nothing
        (2, (0.3, -1.87, 0.5), True),  # it hangs down, and carries all of the load
    ],
)
def test_a_joint_weighs_where_it_carries_the_load(
    joint: int, pose: tuple[float, ...], permitted: bool
) -> None:
    """With a model of another machine, by the motion of one joint alone."""
    moving = np.arange(3) == joint
    pressures = np.full(3, 5e6)
    speed = np.where(moving, 0.1, 0.0)
    balance = TipMechanics.of(known()).balance(
        MeanMotion(np.array(pose), speed, np.zeros(3), pressures, pressures)
    )
    window = Balanced(
        0.15, balance, moving, ~moving, moving, np.zeros(3), np.zeros((3, 3)), moving & False,
        np.zeros(3), np.zeros((3, 3)),
    )  # fmt: skip
    doubt = ModelDoubt()
    worst = WORST_SHARE * doubt.unknown
    assert (attainable(LoadFilter(doubt, 3), window) < worst) == permitted


def test_a_model_without_values_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="no values yet"):
        PayloadEstimator(load_model(machine_file("model.yaml")))


def of_the_whole(estimates: list[PayloadEstimate]) -> list[Lift]:
    """From all estimates between two changes at once."""
    parts: list[list[PayloadEstimate]] = [[]]
    for estimate in estimates:
        if estimate.changed and parts[-1]:
            parts.append([])
        parts[-1].append(estimate)
    found = (lift_of(part, estimates[0].time) for part in parts if part)
    return [estimate for estimate in found if estimate is not None]


def test_lifts_that_are_logged_as_they_end_are_those_of_the_whole() -> None:
    found, log = weighed(), LiftLog()
    ended = [log.add(estimate) for estimate in found]
    assert [lift for lift in (*ended, log.end()) if lift is not None] == of_the_whole(found)
    assert lifts(found) == of_the_whole(found)
    assert lifts(found)


def test_a_lift_of_an_hour_is_remembered_by_its_best() -> None:
    found, log = weighed(), LiftLog()
    rest = (found[-1]._replace(time=found[-1].time + k, changed=False) for k in range(1, 3600))
    long = [*found, *rest]
    ended = [log.add(estimate) for estimate in long]
    assert [lift for lift in (*ended, log.end()) if lift is not None] == of_the_whole(long)
