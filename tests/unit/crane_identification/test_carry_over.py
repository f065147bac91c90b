"""What is said of a model that does not predict other recordings as well."""

import numpy as np

from crane_identification.validation.force_validation import elsewhere

JOINTS = ("inner_boom", "outer_boom", "telescope")


def test_one_warning_lists_the_joints_that_err_more() -> None:
    trained, noise = np.full(3, 0.01), np.array([0.001, 0.001, np.nan])
    (warning,) = elsewhere(JOINTS, np.array([0.02, 0.011, 0.03]), trained, noise)
    assert "errs by 2.0\u202f% on the inner boom (1.0\u202f% in training) and by 3.0" in warning
    assert "outer boom" not in warning
    assert elsewhere(JOINTS, trained, trained, noise) == ()
