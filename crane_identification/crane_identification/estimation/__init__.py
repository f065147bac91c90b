"""Θ and its uncertainty, (28)-(31)."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.estimation.estimate import Estimate as Estimate
    from crane_identification.estimation.lack_of_fit import LackOfFit as LackOfFit
    from crane_identification.estimation.physics import Physics as Physics
    from crane_identification.estimation.regression import build_rows as build_rows
    from crane_identification.estimation.rows import Rows as Rows

_HOMES = {
    "Estimate": "estimate",
    "LackOfFit": "lack_of_fit",
    "Physics": "physics",
    "Rows": "rows",
    "build_rows": "regression",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
