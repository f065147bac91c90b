"""Joints in any order, or one alone, give what each gives in the packaged model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from laboratory_crane import JOINT_UNITS
from unit.crane_identification.online.online_crane import record_log
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Log, Signal, fit, validate
from crane_identification.online.replay import replay
from crane_identification.validation.motion_validation import validate_motion
from crane_model import Model
from crane_model.terms.friction import Coulomb, CoulombAsymmetry, Viscous
from crane_model.terms.single_axis import Inertia
from crane_model.terms.term import Setting

TURNED = ("telescope", "outer_boom", "inner_boom")
ALONE = (Inertia, Coulomb, CoulombAsymmetry, Viscous)


def of_joints(log: Log, joints: Sequence[str]) -> Log:
    """The recording of these joints alone, in this order."""
    at = [log.joints.index(joint) for joint in joints]
    signals = {
        name: Signal(var.time, var.value[:, at], var.origin)
        for name, var in vars(log).items()
        if isinstance(var, Signal)
    }
    return replace(log, joints=tuple(joints), **signals)


def setting(model: Model, joints: Sequence[str]) -> Setting:
    return Setting({joint: JOINT_UNITS[joint] for joint in joints}, model.machine)


def test_the_order_of_joints_changes_nothing() -> None:
    """Fit, held-out error and simulated motion of the crane."""
    model, logs = crane_model(), [crane_log(1), crane_log(2)]
    plain = fit(model, logs[:1])
    turned = fit(replace(model, setting=setting(model, TURNED)), [of_joints(logs[0], TURNED)])
    close = 1e-3 * plain.estimate.std_devs
    np.testing.assert_allclose(turned.estimate.values, plain.estimate.values, atol=close.min())
    (expected,) = validate(plain.model, logs[1:])
    (got,) = validate(turned.model, [of_joints(logs[1], TURNED)])
    np.testing.assert_allclose(got.relative_error[::-1], expected.relative_error, rtol=1e-6)
    moved, as_before = (
        validate_motion(log.model, [held.preparation.record]).relative
        for log, held in ((turned, got), (plain, expected))
    )
    np.testing.assert_allclose(moved[::-1], as_before, rtol=1e-6)


@pytest.mark.parametrize("joint", ["inner_boom", "telescope"])
def test_one_joint_alone_is_fitted_validated_and_simulated(joint: str) -> None:
    """Through its linkage as with the forces that the whole crane has there."""
    crane = crane_model()
    model = Model("alone", setting(crane, [joint]), tuple(name(joint=joint) for name in ALONE))
    logs = [of_joints(crane_log(seed), [joint]) for seed in (1, 2)]
    fitted = fit(model, logs[:1])
    (held_out,) = validate(fitted.model, logs[1:])
    whole = fit(crane, [crane_log(1)])
    j = crane.joints.index(joint)
    alone_record, all_joints = (result.preparations[0].record for result in (fitted, whole))
    period = len(alone_record) * (
        alone_record.time[1] - alone_record.time[0]
    )  # which may begin at another sample
    expected = np.interp(alone_record.time, all_joints.time, all_joints.force[:, j], period=period)
    np.testing.assert_allclose(
        alone_record.force[:, 0], expected, atol=1e-3 * np.abs(expected).max()
    )
    assert np.isfinite(held_out.relative_error).all()
    motion = validate_motion(fitted.model, [held_out.preparation.record])
    assert motion.reason or np.isfinite(motion.relative).all()


def test_one_joint_alone_is_identified_online() -> None:
    """The forces that the node publishes are those of the joint in the whole crane."""
    crane, log = crane_model(), record_log(4.0)
    model = Model("alone", setting(crane, ["outer_boom"]), (Inertia(joint="outer_boom"),))
    whole, alone = replay(crane, log)[1], replay(model, of_joints(log, ["outer_boom"]))[1]
    assert len(alone) == len(whole) > 30
    for fitted, whole_result in zip(alone, whole, strict=True):
        np.testing.assert_allclose(fitted.measured, whole_result.measured[1:2], rtol=1e-9)
