"""Models whose valves nobody identified: the weight of the crane tells, or the joint is refused."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_observer.observed import JOINTS, known, recording
from unit.crane_observer.test_position_estimator import ALL, errors, rms

from crane_model import ConfigurationError, Machine, Model
from crane_model.hydraulics import HydraulicValues
from crane_observer import PositionEstimator
from crane_observer.position.balance import Known
from crane_observer.position.estimator import EstimatorCondition
from crane_observer.position.filter import refuse_unserved, told_by_weight
from crane_observer.position.flow import ASSUMED_VALVE
from crane_observer.position.replay import replay

BARE = replace(known(), hydraulics=None)
ABOUT = np.array([5e-2, 5e-2, 1e-1])  # rad, rad, m


def only(joint: int) -> np.ndarray:
    return np.arange(len(JOINTS)) == joint


@pytest.mark.parametrize("lost", range(3))
def test_one_joint_goes_on_by_its_weight_and_says_how_well(lost: int) -> None:
    course = replay(PositionEstimator(BARE, recording().encoders[0]), recording(), only(lost))
    away = errors(course)
    assert rms(away)[lost] < ABOUT[lost]
    assert (np.abs(away[:, lost]) < 1.96 * course.deviation[:, lost]).mean() > 0.9
    assert course.deviation[-1, lost] < 2.0 * ABOUT[lost]  # it does not drift away
    assert set(course.conditions[3:]) == {EstimatorCondition.VALVES_UNKNOWN}
    assert rms(away)[~only(lost)].max() < 2e-4


def test_with_all_encoders_nothing_is_lacking() -> None:
    course = replay(PositionEstimator(BARE, recording().encoders[0]), recording(), ~ALL)
    assert set(course.conditions[3:]) == {EstimatorCondition.GOOD}
    assert course.observable[3:].all()


def test_several_joints_without_encoders_are_not_to_be_believed() -> None:
    hidden = np.array([True, True, False])
    course = replay(PositionEstimator(BARE, recording().encoders[0]), recording(), hidden)
    assert set(course.conditions[3:]) <= {
        EstimatorCondition.UNSERVED, EstimatorCondition.LOAD_IMPOSSIBLE,
    }  # fmt: skip
    assert not course.observable[3:, :2].any()
    with pytest.raises(ConfigurationError, match="valves of inner_boom, outer_boom are not"):
        refuse_unserved(BARE, hidden)


def test_where_one_valve_is_not_identified_the_others_are_used() -> None:
    hydraulics = known().hydraulics
    assert hydraulics is not None
    joints = {
        joint: parameters for joint, parameters in hydraulics.joints.items() if joint != JOINTS[0]
    }
    model = replace(known(), hydraulics=HydraulicValues(provenance="two", joints=joints))
    assert Known.of(model, np.zeros(3)).assumed.tolist() == [True, False, False]
    gains = Known.of(model, np.zeros(3)).spread[Known.of(model, np.zeros(3)).layout.extending]
    assert gains[0] == ASSUMED_VALVE.gain_doubt and (gains[1:] < 0.01).all()
    course = replay(PositionEstimator(model, recording().encoders[0]), recording(), only(1))
    assert rms(errors(course))[1] < 2e-3
    assert set(course.conditions[3:]) == {EstimatorCondition.GOOD}
    assert refuse_unserved(model, ~only(0)) == []
    (warning,) = refuse_unserved(model, ALL)
    assert warning.startswith("inner_boom: its valve is not identified")


def weightless() -> Model:
    assert BARE.machine is not None
    return on(BARE.machine.model_copy(update={"gravity_given": 1e-9}))


def on(machine: Machine | None) -> Model:
    """The model on another machine."""
    return replace(BARE, setting=BARE.setting._replace(machine=machine))


def test_a_joint_whose_weight_tells_nothing_is_refused() -> None:
    assert told_by_weight(Known.of(BARE, np.zeros(3))).all()
    assert not told_by_weight(Known.of(weightless(), np.zeros(3))).any()
    with pytest.raises(ConfigurationError, match="telescope: its valve is not identified"):
        refuse_unserved(weightless(), only(2))
    refuse_unserved(replace(weightless(), hydraulics=known().hydraulics), only(2))


def test_a_model_without_a_machine_or_transducers_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="names no machine file"):
        PositionEstimator(on(None), np.zeros(3))
    machine = BARE.machine
    assert machine is not None
    joint = machine.joints[machine.index("telescope")]
    blind = joint.model_copy(
        update={"actuator": joint.actuator.model_copy(update={"pressure_sensors": False})}
    )
    joints = tuple(blind if name is joint else name for name in machine.joints)
    with pytest.raises(ConfigurationError, match="telescope: it has no chambers with pressure"):
        PositionEstimator(on(machine.model_copy(update={"joints": joints})), np.zeros(3))
