from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.synthetic import (
    AXIS_THETA,
    LEAD,
    PERIOD,
    RATE,
    RESOLUTION,
    axis_log,
    axis_model,
    crane_log,
    crane_model,
)

from crane_identification import Estimator, FitResult, Log, Options, Signal, fit, validate
from crane_identification.estimation.excitation import redundancies
from crane_identification.estimation.prior import load_prior
from crane_identification.preparation.prepare import prepare
from crane_identification.report.content import pooled
from crane_identification.report.findings import findings
from crane_model import ConfigurationError, DataError, Model, Record, load_model


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> Model:
    return axis_model(tmp_path_factory.mktemp("models"))


@pytest.fixture(scope="module")
def fitted_crane() -> FitResult:
    return fit(crane_model(), [crane_log(seed=1), crane_log(seed=2)])


def test_simulated_crane_is_found(fitted_crane: FitResult) -> None:
    """All 20 parameters, from pressures and rounded encoders, within three standard deviations."""
    estimate, truth = fitted_crane.estimate, crane_model().theta
    deviation = np.abs(estimate.values - truth) / estimate.std_devs
    assert np.sort(deviation)[-2] < 3.0, dict(zip(estimate.names, deviation, strict=True))
    assert (estimate.std_devs < 0.1 * np.abs(truth)).all()
    assert estimate.names == tuple(p.name for p in crane_model().parameters)
    np.testing.assert_array_equal(fitted_crane.model.theta, estimate.values)
    assert "crane 1, crane 2" in fitted_crane.model.provenance


def test_simulated_crane_is_validated_down_to_the_noise(fitted_crane: FitResult) -> None:
    (validation,) = validate(fitted_crane.model, [crane_log(seed=3)])
    assert (validation.relative_error < 0.01).all()
    errors = pooled(fitted_crane.model, [validation])
    assert (errors.without_gravity >= validation.relative_error).all()
    assert (errors.moving < 2 * errors.noise_floor).all()
    measured = np.linalg.norm(validation.measured, axis=0)
    error = np.linalg.norm(validation.measured - validation.predicted, axis=0)
    np.testing.assert_allclose(validation.relative_error, error / measured)


def test_reversals_that_are_not_masked_bias_the_fit(axis: Model) -> None:
    """An axis that stands for a moment at each reversal, as a valve with a dead band makes it."""
    logs = [axis_log(seed, axis, dead_band=0.01) for seed in (1, 2)]
    masked = fit(axis, logs).estimate
    unmasked = fit(axis, logs, Options(mask_reversals=False)).estimate
    np.testing.assert_allclose(masked.values, AXIS_THETA, rtol=0.03)
    assert np.abs(unmasked.values - AXIS_THETA)[2] > 10 * np.abs(masked.values - AXIS_THETA)[2]
    assert unmasked.relative_error > 5 * masked.relative_error


@pytest.mark.parametrize("options", [Options(), Options(average=False), Options(decimation=1)])
def test_simulated_axis_is_found(axis: Model, options: Options) -> None:
    """Averaged or not, filtered or not."""
    estimate = fit(axis, [axis_log(1, axis), axis_log(2, axis)], options).estimate
    assert (np.abs(estimate.values - AXIS_THETA) < 3.5 * estimate.std_devs).all()
    assert (estimate.std_devs < 0.1 * np.abs(AXIS_THETA)).all()


def test_averaging_report(axis: Model) -> None:
    """The periods, what is outside them, and the noise that their scatter shows."""
    noise = 2.0
    (preparation,) = prepare(axis, axis_log(3, axis, periods=3.3, noise=noise), Options())
    averaging = preparation.averaging
    assert averaging is not None
    assert averaging.period == pytest.approx(PERIOD, rel=1e-6)
    assert (averaging.used, averaging.transient) == (3, 0)
    assert averaging.incomplete == pytest.approx(0.3 * PERIOD, abs=0.1)
    assert len(preparation.record) == round(PERIOD * RATE)
    assert preparation.periods.shape == (3, 2000, 1)
    scatter = preparation.periods.std(axis=0, ddof=1)
    assert np.sqrt(np.mean(scatter**2)) == pytest.approx(noise, rel=0.05)
    mean = preparation.periods.mean(axis=0)
    np.testing.assert_array_equal(preparation.record.force, mean)
    (last,) = prepare(axis, axis_log(3, axis, periods=3.3, noise=noise), Options(periods=1))
    np.testing.assert_array_equal(last.periods[0], preparation.periods[-1])


def test_without_a_reference_the_positions_show_the_period(axis: Model) -> None:
    """And what does not belong to it: faster motion before and after it."""
    log = axis_log(4, axis)
    with_reference = prepare(axis, log, Options())[0]
    log = replace(log, reference_position=None)
    for period in (None, PERIOD):
        (preparation,) = prepare(axis, log, Options(period=period))
        assert preparation.averaging is not None
        assert preparation.averaging.period == pytest.approx(PERIOD, abs=1e-4)
        assert preparation.averaging.used == 3
        floor, expected = (p.periods.std(axis=0).mean() for p in (preparation, with_reference))
        assert floor == pytest.approx(expected, rel=0.05)
        np.testing.assert_allclose(
            fit(axis, [log], Options(period=period)).estimate.values, AXIS_THETA, rtol=0.02
        )


@pytest.mark.parametrize("lacking", [0, 1, 3])
def test_samples_that_span_one_step_less_are_whole_periods(axis: Model, lacking: int) -> None:
    """N samples span N - 1 steps, and forces begin later than positions."""
    log = axis_log(5, axis, periods=3)
    assert log.force is not None
    n = round(PERIOD * RATE)
    begin = round(LEAD * RATE)
    part = slice(begin, begin + 3 * n)
    q, f = log.position, log.force
    late = slice(part.start + lacking, part.stop)
    log = replace(
        log,
        position=Signal(q.time[part], q.value[part], "q"),
        force=Signal(f.time[late], f.value[late], "f"),
        reference_position=None,
    )
    (preparation,) = prepare(axis, log, Options(period=PERIOD))
    assert preparation.averaging is not None
    assert preparation.averaging.used == 3
    assert preparation.averaging.incomplete == 0.0
    assert preparation.periods.shape == (3, n, 1)
    np.testing.assert_allclose(fit(axis, [log]).estimate.values, AXIS_THETA, rtol=0.02)


def test_a_machine_that_did_not_follow_its_reference_is_not_averaged(axis: Model) -> None:
    log = axis_log(6, axis)
    time = log.position.time
    drifting = np.cumsum(np.cumsum(np.random.default_rng(1).normal(size=len(time))))
    log = replace(log, position=Signal(time, drifting[:, None] / np.ptp(drifting), "q"))
    with pytest.raises(DataError, match=r"r repeats after 20 s, but the measured motion does not"):
        fit(axis, [log])


def test_a_gap_splits_the_recording(axis: Model) -> None:
    """Each side holds whole periods of its own."""
    log = axis_log(5, axis, periods=5)
    kept = ~((log.position.time > 45.0) & (log.position.time < 47.0))
    gap = replace(log, force=Signal(log.force.time[kept], log.force.value[kept], "f"))
    parts = prepare(axis, gap, Options())
    assert [part.averaging.used for part in parts if part.averaging] == [2, 2]
    np.testing.assert_allclose(fit(axis, [gap]).estimate.values, AXIS_THETA, rtol=0.02)


def test_rows_near_reversals_are_not_used(axis: Model) -> None:
    result = fit(axis, [axis_log(6, axis)])
    (preparation,) = result.preparations
    velocity = preparation.record.velocity[:, 0]
    assert not preparation.moving[np.abs(velocity) < 1e-4].any()
    resolution = preparation.record.velocity_resolution
    assert resolution is not None
    assert 0 < resolution[0] < 0.05 * np.abs(velocity).max()
    assert 0.5 < preparation.moving.mean() < 0.98
    assert not result.rows.used.all()


def test_rows_where_one_period_stands_are_not_used(axis: Model) -> None:
    """In the second period the axis sets off 0.8 s later after a reversal, and catches up."""
    log = axis_log(6, axis)
    assert log.reference_position is not None
    time, asked = log.position.time, log.reference_position.value[:, 0]
    second = (time > LEAD + PERIOD) & (time < LEAD + 2 * PERIOD - 2.0)
    turns = np.flatnonzero(second[1:-1] & (np.diff(asked)[1:] * np.diff(asked)[:-1] < 0)) + 1
    since = time - time[turns[0]]
    caught_up = np.clip((since - 0.8) / 0.4, 0.0, 1.0)
    late = asked[turns[0]] + caught_up**2 * (3 - 2 * caught_up) * (asked - asked[turns[0]])
    stuck = np.where((since > 0.0) & (since < 1.2), late, asked)
    late_log = replace(log, position=Signal(time, stuck[:, None], "q"))
    both = [prepare(axis, recording, Options())[0] for recording in (log, late_log)]
    instant = round((time[turns[0]] + 0.6 - LEAD) * RATE) % round(PERIOD * RATE)
    assert [bool(preparation.moving[instant, 0]) for preparation in both] == [True, False]
    assert [bool(preparation.signed[instant, 0]) for preparation in both] == [True, False]


def test_motion_in_one_direction_leaves_parameters_undetermined(axis: Model) -> None:
    """Coulomb friction and offset are then one number; both are named."""
    time = np.arange(0.0, 30.0, 1 / RATE)
    q = 0.2 * time + 0.05 * np.sin(time)
    force = 12.0 * -0.05 * np.sin(time) + 30.0 * (0.2 + 0.05 * np.cos(time)) + 8.0 - 1.5
    force += 0.1 * np.random.default_rng(7).normal(size=len(time))
    log = Log(
        "one way", ("axis",), 0, Signal(time, q[:, None], "q"),
        force=Signal(time, force[:, None], "f"),
    )  # fmt: skip
    with pytest.raises(
        DataError, match=r"f_c\.axis, offset\.axis: .* only combinations.*axis moves up"
    ):
        fit(axis, [log], Options(average=False))


@pytest.mark.parametrize("average", [False, True])
def test_a_recording_that_stands_still_is_left_out_beside_one_that_moves(
    axis: Model, average: bool
) -> None:
    options, moved = Options(average=average, period=PERIOD), axis_log(1, axis, periods=4)
    there = Signal(moved.position.time, np.full_like(moved.position.value, 0.3), "still")
    still = replace(moved, source="still", position=there, reference_position=there)
    found, alone = fit(axis, [still, moved], options), fit(axis, [moved], options)
    assert found.standing == ("still",)
    assert "still: these recordings do not contribute" in findings(found, [still, moved])[0]
    assert found.estimate.values == pytest.approx(alone.estimate.values)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_every_estimator_finds_the_axis(axis: Model, estimator: Estimator) -> None:
    """From a log with a reference, which only the instruments need."""
    logs = [_with_reference(axis_log(seed, axis)) for seed in (1, 2)]
    estimate = fit(axis, logs, Options(estimator=estimator)).estimate
    np.testing.assert_allclose(estimate.values, AXIS_THETA, rtol=0.03)
    assert (np.abs(estimate.values - AXIS_THETA) < 4.0 * estimate.std_devs).all()
    assert estimate.undetermined == ()


def _with_reference(log: Log) -> Log:
    assert log.reference_position is not None
    time, q = log.reference_position.time, log.reference_position.value
    v = np.gradient(q, time, axis=0)
    velocity, acceleration = Signal(time, v, "r"), Signal(time, np.gradient(v, time, axis=0), "r")
    return replace(log, reference_velocity=velocity, reference_acceleration=acceleration)


def test_instruments_need_the_whole_reference(axis: Model) -> None:
    with pytest.raises(DataError, match="axis 1: instrumental variables need the reference"):
        fit(axis, [axis_log(1, axis)], Options(estimator=Estimator.INSTRUMENTAL))


def test_what_was_not_excited_is_said_of_the_joint() -> None:
    """The inner boom does not move at all: its inertia, its friction are in no row."""
    log = crane_log(seed=1)
    still = log.position.value.copy()
    still[:, 0] = 0.45
    held = replace(
        log,
        position=replace(log.position, value=still),
        reference_position=replace(log.position, value=still),
    )
    with pytest.raises(DataError, match=r"f_c\.inner_boom.*inner_boom does not move"):
        fit(crane_model(), [held])


def test_a_machine_that_stands_still_is_refused(axis: Model) -> None:
    time = np.arange(0.0, 30.0, 1 / RATE)
    still = Signal(time, np.full((len(time), 1), 0.3), "q")
    log = Log("still", ("axis",), 0, still, force=Signal(time, np.ones((len(time), 1)), "f"))
    with pytest.raises(DataError, match="no joint .* moves fast enough"):
        fit(axis, [log], Options(average=False))


def test_slew_beside_the_joints_reaches_the_record() -> None:
    log = crane_log(seed=8)
    time = log.position.time
    slew = Signal(time, 0.3 * np.sin(2 * np.pi * time / PERIOD), "/joint_states")
    (preparation,) = prepare(crane_model(), replace(log, slew_position=slew), Options())
    record = preparation.record
    assert record.slew_velocity is not None and record.slew_acceleration is not None
    speed = 0.3 * 2 * np.pi / PERIOD
    assert np.abs(record.slew_velocity).max() == pytest.approx(speed, rel=0.01)
    assert record.position.shape == (2000, 3)
    assert record.pressure_a is not None and record.pressure_a.shape == (2000, 3)


def test_a_slew_joint_that_is_held_costs_nothing() -> None:
    log = crane_log(seed=9)
    held = Signal(log.position.time, np.full(len(log.position.time), 0.1), "/joint_states")
    with_slew = fit(crane_model(), [replace(log, slew_position=held)], Options(average=False))
    without = fit(crane_model(), [log], Options(average=False))
    np.testing.assert_allclose(with_slew.estimate.values, without.estimate.values, rtol=1e-9)


def test_progress_reaches_the_end(axis: Model) -> None:
    told: list[tuple[str, float]] = []
    fit(axis, [axis_log(10, axis), axis_log(11, axis)], None, lambda *done: told.append(done))
    shares = [share for phase, share in told if phase == "motion"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert told[-1] == ("fit", 1.0)


def test_errors_name_recording_and_remedy(axis: Model) -> None:
    log = axis_log(12, axis)
    with pytest.raises(DataError, match="axis 12: holds the joints axis, but the model has inner"):
        fit(crane_model(), [log])
    with pytest.raises(DataError, match="axis 12: holds neither generalized forces nor"):
        fit(axis, [replace(log, force=None)])
    with pytest.raises(DataError, match="no recordings given"):
        fit(axis, [])
    with pytest.raises(
        DataError, match="axis 12: .* period of 13 s: .* repeats after 20 s; .* --no-av"
    ):
        fit(axis, [log], Options(period=13.0))
    with pytest.raises(DataError, match="too little is left of"):
        fit(axis, [log], Options(average=False, trim=(5000, 5000)))
    with pytest.raises(ConfigurationError, match="has no values yet"):
        validate(axis, [log])


def test_same_logs_same_result(axis: Model, tmp_path: Path) -> None:
    logs = [axis_log(13, axis), axis_log(14, axis)]
    first, second = fit(axis, logs), fit(axis_model(tmp_path), logs)
    np.testing.assert_array_equal(first.estimate.covariance, second.estimate.covariance)


def strokes(count: int, speeds: tuple[float, ...], ramp: float, hold: float = 1.5) -> Log:
    """To and fro by trapezoids of these speeds [m/s], both ways; a force of 0.5 N of noise."""
    parts = []
    for k in range(count):
        speed = speeds[k // 2 % len(speeds)] * (1.0 if k % 2 == 0 else -1.0)
        up = np.linspace(0.0, speed, round(ramp * 200))
        parts += [up, np.full(round(hold * 200), speed), up[::-1], np.zeros(60)]
    v = np.concatenate(parts)
    time = np.arange(len(v)) / 200.0
    inertia, viscous, coulomb, offset = AXIS_THETA
    force = inertia * np.gradient(v, time) + viscous * v + coulomb * np.sign(v) + offset
    force[v == 0.0] = 0.0
    force += 0.5 * np.random.default_rng(count).standard_normal(len(v))
    q = RESOLUTION * np.round(np.cumsum(v) / 200.0 / RESOLUTION)
    force_read = Signal(time, force[:, None], "f")
    return Log("strokes", ("axis",), 0, Signal(time, q[:, None], "q"), force=force_read)


@pytest.mark.parametrize("count", [4, 16])
@pytest.mark.parametrize("ramp", [0.05, 0.2])
@pytest.mark.parametrize("estimator", [Estimator.LEAST_SQUARES, Estimator.CONSISTENT])
def test_one_speed_does_not_tell_viscous_from_coulomb_friction(
    axis: Model, count: int, ramp: float, estimator: Estimator
) -> None:
    """However many strokes, and though the rounded ends of the ramps differ a little."""
    options = Options(average=False, estimator=estimator)
    with pytest.raises(
        DataError, match=r"f_v.axis, f_c.axis: .* axis moves at one speed, 0.(2|19)"
    ):
        fit(axis, [strokes(count, (0.2,), ramp)], options)


def test_two_speeds_tell_them_apart(axis: Model) -> None:
    estimate = fit(axis, [strokes(8, (0.2, 0.1), 0.2)], Options(average=False)).estimate
    assert (np.abs(estimate.values - AXIS_THETA) < 3.5 * estimate.std_devs)[1:].all()


def test_one_speed_and_a_prior(axis: Model, tmp_path: Path) -> None:
    """What is known of one of both frictions gives the other."""
    path = tmp_path / "prior.yaml"
    path.write_text("parameters: {f_c.axis: {value: 8, std_dev: 0.2}}")
    known = load_prior(path, axis)
    log = strokes(8, (0.2,), 0.05)
    estimate = fit(axis, [log], Options(average=False), prior=known).estimate
    assert estimate.values[1] == pytest.approx(30.0, abs=3.0 * estimate.std_devs[1])


TURNTABLE = """
name: turntable
gravity: 9.81
joints:
  - name: base
    kind: revolute
    axis: [0, 0, 1]
    limits: &limits
      {position_min: -3, position_max: 3, velocity_min: -2, velocity_max: 2}
    actuator: {type: electric_drive, gear_ratio: 120}
  - name: arm
    kind: revolute
    origin: {xyz: [0.3, 0, 0.5], rpy: [0, 0, 0]}
    axis: [0, 1, 0]
    limits: *limits
    actuator: {type: electric_drive, gear_ratio: 100}
"""


def turntable(folder: Path, *terms: str, more: str = "") -> Model:
    (folder / "machine.yaml").write_text(TURNTABLE + more)
    path = folder / "model.yaml"
    lines = ["name: arm", "machine: machine.yaml", "joints: {base: rad, arm: rad}", "terms:"]
    path.write_text("\n".join([*lines, *(f"  - {{{term}}}" for term in terms)]))
    return load_model(path)


def turntable_log(model: Model, still: str = "") -> Log:
    """Both joints by sums of sines, or one of them `still`."""
    rng, time = np.random.default_rng(5), np.arange(0.0, 40.0, 0.01)
    omega = 2.0 * np.pi * np.array([[0.1, 0.23, 0.41], [0.13, 0.29, 0.37]])
    angle = time[:, None, None] * omega
    size = np.array([0.5, 0.0 if still == "arm" else 0.4])
    q, v, a = (
        size * signal.sum(axis=2)
        for signal in (np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle))
    )
    columns = model.regressor(Record(model.joints, time, q, v, a))
    force = columns @ rng.uniform(1.0, 2.0, columns.shape[2]) + rng.normal(size=q.shape)
    return Log("made", model.joints, 0, Signal(time, q, "q"), force=Signal(time, force, "f"))


def test_what_no_motion_separates_is_not_blamed_on_excitation(tmp_path: Path) -> None:
    """The rotor of the first axis turns as its link does; that of the second one does not."""
    terms = ("type: serial_rigid_body", "type: rotor_inertia, joint: base")
    model = turntable(tmp_path, *terms)
    (found,) = redundancies(model)
    assert found.parameters == ("Izz_r.base", "I_rotor.base")
    assert found.combinations == ("Izz_r.base + 14400 I_rotor.base",)
    with pytest.raises(DataError, match="I_rotor.base: no motion of the machine sep") as refused:
        fit(model, [turntable_log(model)], Options(average=False))
    assert "xcite" not in str(refused.value)


def test_poor_excitation_is_told_from_redundancy(tmp_path: Path) -> None:
    terms = ("type: serial_rigid_body", "type: viscous, joint: arm", "type: coulomb, joint: arm")
    model = turntable(tmp_path, *terms)
    assert redundancies(model) == ()
    with pytest.raises(
        DataError, match="these recordings show only combinations .* arm does not move"
    ):
        fit(model, [turntable_log(model, still="arm")], Options(average=False))


COUPLING = """
couplings:
  - {joints: [base, arm], matrix: [[1, 0], [1, 1]]}
"""


def test_friction_of_a_motor_that_two_joints_turn(tmp_path: Path) -> None:
    """In YAML alone; beside the friction of the joints, and where the motor turns back."""
    frictions = [
        f"type: {kind}, joint: {joint}"
        for kind in ("viscous", "coulomb")
        for joint in ("base", "arm")
    ]
    motors = ("type: motor_viscous, joint: arm", "type: motor_coulomb, joint: arm")
    model = turntable(tmp_path, "type: serial_rigid_body", *frictions, *motors, more=COUPLING)
    log = turntable_log(model)
    true = np.random.default_rng(5).uniform(1.0, 2.0, len(model.parameters))
    options = Options(average=False, estimator=Estimator.LEAST_SQUARES)  # bodies of any values
    estimate = fit(model, [log], options).estimate
    assert estimate.names[-2:] == ("f_v_motor.arm", "f_c_motor.arm")
    assert (np.abs(estimate.values - true) < 3.5 * estimate.std_devs).all()
    assert (estimate.std_devs[-2:] < 0.1).all()
    (prepared,) = prepare(model, log, Options(average=False))
    v = prepared.record.velocity
    motor = np.abs(v.sum(axis=1))
    assert motor[prepared.moving.all(axis=1)].min() > 0.01 * motor.max()


def test_friction_of_a_motor_needs_its_coupling(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="'arm' is in no coupling of the machine"):
        turntable(tmp_path, "type: motor_coulomb, joint: arm")
