"""(36) behind the interface, iterative learning, and what the controllers know of a machine."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_trajectory.one_joint import (
    DT,
    JOINT,
    MACHINE,
    PERIOD,
    Boom,
    hydraulics,
    model,
    swing,
)

from crane_model import ConfigurationError, Model, Record, load_machine, load_model, save_model
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.machine_files import machine_file
from crane_trajectory.control.choice import (
    MAY_LEARN,
    NAMES,
    PD_DEAD_BAND,
    Learning,
    controller,
    in_words,
    learning,
    learnt_hydraulics,
    led_by_model,
)
from crane_trajectory.control.controller import (
    ControlCondition,
    GainFields,
    PdDeadBand,
    Point,
    SensorReading,
    Tuning,
    Wanted,
    command,
    load_gains,
)
from crane_trajectory.control.flow_feedforward import FlowFeedforward, ReferenceLoad
from crane_trajectory.control.valves_and_oil import length_and_lever, tables

GAINS = GainFields(*(np.array([gain]) for gain in (6.0, 0.1, 0.06, 0.05, 0.02, 0.003)))
ZERO = np.zeros(1)


def reading(position: float, velocity: float) -> SensorReading:
    nothing = np.array([np.nan])
    return SensorReading(np.array([position]), np.array([velocity]), nothing, nothing, np.nan)


def test_36_is_itself_when_its_start_is_over() -> None:
    made, at = PdDeadBand(GAINS), swing(0.7)
    made.start(np.array([0.3]))
    first = made.command(DT, reading(0.0, 0.01), Wanted(at, at))
    assert first[0] == pytest.approx(0.3)
    for _ in range(1000):
        last = made.command(DT, reading(0.0, 0.01), Wanted(at, at))
    expected = command(GAINS, ZERO, np.array([0.01]), at.position, at.velocity, MACHINE.units)
    assert last == pytest.approx(expected)


def test_36_waits_for_a_velocity_and_stops_where_it_is_lost() -> None:
    made, at = PdDeadBand(GAINS), swing(0.7)
    assert not made.command(DT, reading(0.0, 0.0), Wanted(at, at)).any()
    assert made.conditions == (ControlCondition.NOT_INITIALISED,)
    made.start(ZERO)
    assert not made.command(DT, reading(0.0, np.nan), Wanted(at, at)).any()
    moving = [made.command(DT, reading(0.0, 0.0), Wanted(at, at))[0] for _ in range(300)]
    assert moving[-1] > 0.1
    stopped = [made.command(DT, reading(0.0, np.nan), Wanted(at, at))[0] for _ in range(300)]
    assert made.conditions == (ControlCondition.NOT_MEASURED,)
    assert np.abs(np.diff([moving[-1], *stopped])).max() < 0.03
    assert stopped[-1] == 0.0


def test_learning_does_not_diverge_in_20_periods() -> None:
    wrong = hydraulics(
        supply_a=0.8e-7, b_tank=0.8e-7, dead_band_extend=0.05, dead_band_retract=0.06
    )
    led = FlowFeedforward(MACHINE, model(), wrong)
    made = Learning(led, led, PERIOD)
    made.start(ZERO)
    course = Boom(made).run(20 * PERIOD + 0.2)
    errors = [course.rms(k * PERIOD, (k + 1) * PERIOD) for k in range(20)]
    assert max(errors[1:]) <= errors[0]
    assert max(errors[10:]) < 0.4 * errors[0]


class Echo:
    """A loop that answers what is learnt with more error: the worst phase there is."""

    preview, by_model, conditions = 0.0, np.ones(1, dtype=bool), (ControlCondition.AT_REST,)

    def __init__(self) -> None:
        self.told = 0.0  # rad/s

    def start(self, command: np.ndarray) -> None:
        """Nothing to begin with."""

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """Keeps what it is told."""
        self.told = float(wanted.ahead.velocity[0])
        return ZERO


def test_learning_goes_back_where_the_loop_makes_it_worse() -> None:
    echo, still = Echo(), Point(ZERO, ZERO, ZERO)
    made = Learning(echo, FlowFeedforward(MACHINE, model(), hydraulics()), PERIOD)
    made.start(ZERO)
    phases = np.arange(0.0, PERIOD, DT)
    disturbed = 1e-3 * np.sin(2.0 * np.pi * 3.0 * phases / PERIOD)
    course = []
    for _ in range(20):
        errors = []
        for phase, error in zip(phases, disturbed, strict=True):
            errors.append(error + 0.1 * echo.told)
            made.command(DT, reading(-errors[-1], 0.0), Wanted(still, still, float(phase)))
        course.append(np.sqrt(np.mean(np.square(errors))))
    assert max(course[1:4]) > 1.1 * course[0]  # it was tried
    assert course[-1] <= 1.01 * course[0]


def test_the_load_is_what_the_model_predicts() -> None:
    load, point = ReferenceLoad(model(), MACHINE), swing(0.9)
    record = Record((JOINT,), np.zeros(1), *(values[None] for values in point))
    assert load(*point) == pytest.approx(model().predict(record)[0], rel=1e-9)


def test_a_joint_that_the_model_lacks_has_no_load() -> None:
    planar = load_model(machine_file("model.yaml"))
    count = len(planar.parameters)
    planar = planar.with_estimate(np.ones(count), np.ones(count), "by hand")
    crane = load_machine()
    load = ReferenceLoad(planar, crane)(*np.full((3, len(crane.joint_names)), 0.3))
    lacking = [joint not in planar.joints for joint in crane.joint_names]
    np.testing.assert_array_equal(load == 0.0, lacking)


@pytest.mark.parametrize("machine", [MACHINE, load_machine()])
def test_tables_hold_the_linkages(machine) -> None:
    for joint, table in zip(machine.joint_names, tables(machine), strict=True):
        limits = machine.limits[joint]
        q = np.linspace(limits.position_min, limits.position_max, 700)
        read = np.array([length_and_lever(table, position) for position in q])
        np.testing.assert_allclose(read, machine.cylinder(joint, q)[:, :2], atol=1e-8)


@pytest.mark.parametrize(
    ("field", "value"), [("bulk_modulus", 0.0), ("supply_a", -1e-7), ("leakage", np.nan)]
)
def test_hydraulics_that_cannot_be_are_refused(field: str, value: float) -> None:
    with pytest.raises(ConfigurationError, match=field):
        hydraulics(**{field: value}).records()


VALUES = {
    "dead_band_a": 0.06, "dead_band_b": 0.05, "hysteresis": 0.0, "lag": 0.015,
    "natural_frequency": 150.0, "damping_ratio": 0.8,
    "supply_a": 1e-7, "a_tank": 1e-7, "supply_b": 1e-7, "b_tank": 1e-7,
}  # fmt: skip
CHAMBERS = {
    "bulk_modulus": 1.2e9, "dead_volume_a": 1e-4, "dead_volume_b": 1e-4, "leakage": 0.0
}  # fmt: skip


def known(of: Model, *joints: str, chambers: bool = True) -> Model:
    """The model with the same hydraulics of some joints."""

    def measured(kind: type, values: dict[str, float]) -> dict[str, Measured]:
        return {k: Measured(value=v, unit=kind.units[k]) for k, v in values.items()}

    hydraulics_of_joint = JointHydraulics(
        valve=ValveValues(**measured(ValveValues, VALUES)),
        chambers=ChamberValues(**measured(ChamberValues, CHAMBERS)) if chambers else None,
        unexplained=0.0,
    )
    values = HydraulicValues(
        provenance="by hand", joints=dict.fromkeys(joints, hydraulics_of_joint)
    )
    return replace(of, hydraulics=values)


@pytest.mark.parametrize("name", NAMES)
def test_every_controller_by_name_follows(name: str) -> None:
    made = controller(name, MACHINE, GAINS, known(model(), JOINT))
    made.start(ZERO)
    assert Boom(made).run(PERIOD).rms() < (0.05 if name == PD_DEAD_BAND else 1e-3)


def test_what_a_controller_lacks_is_said() -> None:
    with pytest.raises(ConfigurationError, match="no controller 'pid'; there are pd_dead_band"):
        controller("pid", MACHINE, GAINS)
    with pytest.raises(ConfigurationError, match="needs an identified model with the hydraulics"):
        controller("flow_feedforward", MACHINE, GAINS, model())
    with pytest.raises(ConfigurationError, match="bulk modulus of the oil is unknown"):
        controller("flow_feedforward", MACHINE, GAINS, known(model(), JOINT, chambers=False))
    with pytest.raises(ConfigurationError, match="was not identified with the machine"):
        controller("flow_feedforward", load_machine(), GAINS, known(model(), JOINT))


def test_joints_without_hydraulics_are_led_by_36_and_both_stop_together() -> None:
    crane = load_machine()
    gains = load_gains(machine_file("controller.yaml"), crane).arrays
    planar = load_model(machine_file("model.yaml"))
    planar = planar.with_estimate(*np.ones((2, len(planar.parameters))), "by hand")
    there = [joint for joint in crane.joint_names if joint in planar.joints]
    made = controller("flow_feedforward", crane, gains, known(planar, *there))
    still = np.array([crane.limits[joint].position_max / 2 for joint in crane.joint_names])
    zero, nothing = np.zeros_like(still), np.full_like(still, np.nan)
    at = Point(still + 0.02, zero, zero)
    made.start(zero)
    shown = SensorReading(still, zero, nothing, nothing, 17.5e6)
    for _ in range(50):
        u = made.command(DT, shown, Wanted(at, at))
    led = [crane.joint_names.index(joint) for joint in there]
    lone = [k for k in range(len(still)) if k not in led]
    pd = PdDeadBand(gains)
    pd.start(zero)
    for _ in range(50):
        expected = pd.command(DT, shown, Wanted(at, at))
    np.testing.assert_allclose(u[lone], expected[lone])
    lost = shown._replace(position=np.where(np.isin(np.arange(len(still)), lone), np.nan, still))
    ends = [made.command(DT, lost, Wanted(at, at)) for _ in range(300)]
    assert not ends[-1].any()
    assert np.abs(np.diff([u, *ends], axis=0)).max() < 0.03


def test_what_was_learnt_is_saved_in_the_model_and_loaded_again(tmp_path: Path) -> None:
    wrong = known(model(), JOINT)
    made = controller("adaptive_flow", MACHINE, GAINS, wrong)
    led = led_by_model(made)
    assert led is not None
    made.start(ZERO)
    true = hydraulics(dead_band_extend=0.08, dead_band_retract=0.03, supply_a=0.8e-7)
    course = Boom(made, true).run(4 * PERIOD)
    told = dict(in_words(led))
    assert any("extending" in what and value.startswith("0.08") for what, value in told.items())

    values = learnt_hydraulics(wrong.hydraulics, led)
    save_model(tmp_path / "learnt.yaml", replace(wrong, hydraulics=values))
    again = controller("flow_and_pressures", MACHINE, GAINS, load_model(tmp_path / "learnt.yaml"))
    again.start(ZERO)
    assert Boom(again, true).run(PERIOD).rms() < 2.0 * course.rms(3 * PERIOD)
    naive = controller("flow_and_pressures", MACHINE, GAINS, wrong)
    naive.start(ZERO)
    assert Boom(again, true).run(PERIOD).rms() < 0.2 * Boom(naive, true).run(PERIOD).rms()
    twice = learnt_hydraulics(values, led)
    assert twice.provenance == values.provenance


def test_only_laws_that_do_not_adapt_learn_a_motion() -> None:
    for name in NAMES:
        made = controller(name, MACHINE, GAINS, known(model(), JOINT))
        if name in MAY_LEARN:
            assert isinstance(learning(name, made, PERIOD), Learning)
        else:
            with pytest.raises(ConfigurationError, match=f"'{name}': does not learn"):
                learning(name, made, PERIOD)


def test_joints_controlled_by_a_model_stay_within_a_tenth() -> None:
    tuning = Tuning(GAINS, 1.0, np.array([0.2, 0.1]))
    tight = tuning.tightened(np.array([True, False]))
    np.testing.assert_allclose(tight.tolerance, [0.02, 0.1])
    assert controller("flow_feedforward", MACHINE, GAINS, known(model(), JOINT)).by_model.all()
    assert not controller(PD_DEAD_BAND, MACHINE, GAINS).by_model.any()
