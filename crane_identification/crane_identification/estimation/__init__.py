"""Θ and its uncertainty, (28)-(31)."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.estimation.autoregression import LackOfFit as LackOfFit
    from crane_identification.estimation.estimate import Estimate as Estimate
    from crane_identification.estimation.physics import Physics as Physics
    from crane_identification.estimation.regression import Rows as Rows
    from crane_identification.estimation.regression import build_rows as build_rows

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "autoregression": ("LackOfFit",),
        "estimate": ("Estimate",),
        "physics": ("Physics",),
        "regression": ("Rows", "build_rows"),
    },
)
