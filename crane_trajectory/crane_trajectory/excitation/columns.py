"""Named sets of regressor columns: a condition number compares only within one of them."""

from enum import StrEnum

import numpy as np
from scipy.linalg import block_diag

from crane_model.base_parameters import report_from_base
from crane_model.dynamics import Geometry
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.terms.rigid_body import BASE_PARAMETERS


class ColumnSet(StrEnum):
    """Which columns count."""

    BASE = "base"  # all columns of the model
    REPORT = "report"  # those of (9), and of all other terms
    INERTIAL = "inertial"  # those of the rigid bodies alone


def column_map(model: Model, columns: ColumnSet) -> np.ndarray:
    """(p, c): Phi times this is the regressor of the c columns of the set.

    Raises `ConfigurationError` if the model has no columns of (9).
    """
    every = np.eye(len(model.parameters))
    if columns is ColumnSet.BASE:
        return every
    if columns is ColumnSet.INERTIAL:
        return every[:, inertial_columns(model)]
    if not has_report_columns(model):
        raise ConfigurationError(
            f"model '{model.name}': the columns of (9) are those of the term planar_rigid_body, "
            "which must be its first"
        )
    assert model.machine is not None  # a model of planar_rigid_body has one
    count = len(BASE_PARAMETERS)
    to_report = report_from_base(Geometry.of(model.machine))  # xi_(9) = T xi, so Phi T^-1
    return block_diag(np.linalg.inv(to_report), every[count:, count:])


def has_report_columns(model: Model) -> bool:
    """Whether the model's first columns are those of the base set, from which (9) follows."""
    return model.terms[0].has_base_parameters


def inertial_columns(model: Model) -> np.ndarray:
    """(p,) which columns of the regressor belong to rigid bodies (8), not to friction."""
    return np.concatenate(
        [np.full(len(term.parameters(model.setting)), term.has_inertia()) for term in model.terms]
    )
