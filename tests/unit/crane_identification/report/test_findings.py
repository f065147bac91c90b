from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.report.synthetic_crane import TRUE_VALUES

from crane_identification.preparation.run import Averaging, Drift
from crane_identification.report.findings import findings

STEADY = Drift(np.zeros(3), np.ones(3))


def warnings_of(report, fit=None, logs=()):
    return findings(fit or report.fit, logs, report.validations)


def with_estimate(report, **changes):
    return replace(report.fit, estimate=replace(report.fit.estimate, **changes))


def with_preparation(report, **changes):
    first, *rest = report.fit.preparations
    return replace(report.fit, preparations=(replace(first, **changes), *rest))


def test_a_good_fit_has_no_warnings(report):
    true_values = np.array(list(TRUE_VALUES.values()), dtype=float)
    good = with_estimate(report, values=true_values, std_devs=0.02 * np.abs(true_values))
    assert warnings_of(report, good, report.training) == ()


def test_uncertain_parameters_are_named_with_their_share(report):
    true_values = np.array(list(TRUE_VALUES.values()), dtype=float)
    std_devs = 0.02 * np.abs(true_values)
    std_devs[3] = 0.31 * true_values[3]
    (warning,) = warnings_of(report, with_estimate(report, values=true_values, std_devs=std_devs))
    assert "J_SL (31\u202f%)" in warning
    assert "J_FL" not in warning


def test_values_of_the_wrong_sign_are_not_physical(report):
    true_values = np.array(list(TRUE_VALUES.values()), dtype=float)
    values = true_values.copy()
    values[report.fit.estimate.names.index("m_TL")] = -3.0
    values[report.fit.estimate.names.index("S_FL_normal")] *= -1  # may have either sign
    (warning,) = warnings_of(
        report, with_estimate(report, values=values, std_devs=1e-3 * np.abs(true_values))
    )
    assert "Not physical" in warning
    assert "m_TL" in warning


@pytest.mark.parametrize(
    ("averaging", "words"),
    [
        (Averaging(12.0, 3, 0, 5.0, STEADY), "5.00 s fill no whole period"),
        (Averaging(12.0, 3, 1, 0.0, STEADY), "1 of 4 periods left out at the start"),
        (Averaging(12.0, 1, 0, 0.0, STEADY), "only one period"),
        (
            Averaging(
                12.0, 3, 0, 0.0, Drift(np.array([1.0, 7.0, 1.0]), np.array([0.5, 1e-5, 1.0]))
            ),
            "the force of the outer boom drifts by 7.00 N m a period",
        ),
    ],
)
def test_periods_that_are_lost(report, averaging, words):
    found = warnings_of(report, with_preparation(report, averaging=averaging))
    assert any(words in warning and "train_0" in warning for warning in found)


def test_a_motion_that_is_not_averaged_says_why(report):
    found = warnings_of(report, with_preparation(report, averaging=None, changing=0.21))
    assert any("not averaged: the force changes by 21" in warning for warning in found)


def test_resting_joints_and_what_a_log_says_of_itself(report):
    masked = report.fit.preparations[0].moving.copy()
    masked[:, 2] = False
    moving = tuple(replace(p, moving=masked) for p in report.fit.preparations)
    reversing = replace(report.fit, preparations=moving)
    assert not any("Weak excitation" in w for w in warnings_of(report, reversing))
    standing = tuple(replace(p, signed=masked) for p in report.fit.preparations)
    resting = replace(report.fit, preparations=standing)
    assert any("telescope moves in only 0" in w for w in warnings_of(report, resting))
    first = moving[0]
    velocity = first.record.velocity.copy()
    velocity[len(velocity) // 5 :, 2] *= 1e-3
    once = replace(first, record=replace(first.record, velocity=velocity))
    fits = replace(report.fit, preparations=(once,))
    assert any("telescope moves in only" in w for w in warnings_of(report, fits))

    log = replace(report.training[0], missing=("/valve_command",), notes=("stamps repeated",))
    found = warnings_of(report, logs=[log])
    assert "train_0: not recorded: /valve_command." in found
    assert "train_0: stamps repeated." in found


def test_a_model_that_errs_more_on_recordings_that_it_has_not_seen(report):
    values = report.fit.model.theta.copy()
    values[report.fit.estimate.names.index("f_c.telescope")] *= 1.3
    model = report.fit.model.with_estimate(values, report.fit.estimate.std_devs, "another machine")
    (warning,) = (
        warning
        for warning in warnings_of(report, replace(report.fit, model=model))
        if "carry over" in warning
    )
    assert "on the telescope" in warning
    assert not any("carry over" in warning for warning in warnings_of(report))


def test_a_model_that_was_not_validated(report):
    assert any("not validated" in warning for warning in findings(report.fit, report.training))
