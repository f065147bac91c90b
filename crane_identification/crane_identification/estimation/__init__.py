"""Θ and its uncertainty, (28)-(31)."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.estimation.estimate import Estimate as Estimate
    from crane_identification.estimation.lack_of_fit import LackOfFit as LackOfFit
    from crane_identification.estimation.physics import Physics as Physics
    from crane_identification.estimation.regression import build_rows as build_rows
    from crane_identification.estimation.rows import Rows as Rows

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "estimate": ("Estimate",),
        "lack_of_fit": ("LackOfFit",),
        "physics": ("Physics",),
        "regression": ("build_rows",),
        "rows": ("Rows",),
    },
)
