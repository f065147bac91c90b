"""What repeats from period to period beyond a model: left over, whatever its law may be."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.estimation.lack_of_fit import lack_of_fit
from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.rows import Rows
from crane_identification.preparation import Preparation
from crane_identification.regression import build_rows, common_factor
from crane_model.model_file import Model


class Repeating(NamedTuple):
    """Per joint (j,): root mean square of what repeats, over that of the force, and how likely
    noise alone gives as much.
    """

    strength: np.ndarray
    p_value: np.ndarray


def repeating(model: Model, averaged: Sequence[Preparation]) -> Repeating | None:
    """The test of lack of fit on averaged recordings, to which the model is fitted anew.

    None where no period is repeated: then there is no noise to compare with.
    """
    several = [one for one in averaged if len(one.periods) > 1]
    if not several:
        return None
    factor = common_factor(several)
    rows = Rows.stack([build_rows(model, one, factor) for one in several])
    values = least_squares(rows).values
    found = lack_of_fit(rows, values)
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = np.sqrt(np.maximum(1.0 - 1.0 / found.ratio, 0.0))
        strength = rows.rms(rows.residual(values)) * beyond / rows.rms(rows.force)
    known = np.isfinite(strength)
    return Repeating(np.where(known, strength, 0.0), np.where(known, found.p_value, 1.0))
