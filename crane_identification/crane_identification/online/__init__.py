"""Identification beside the running crane."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.online.estimator import OnlineEstimator as OnlineEstimator
    from crane_identification.online.estimator import OnlineOptions as OnlineOptions
    from crane_identification.online.recursion import Recursion as Recursion

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "estimator": ("OnlineEstimator", "OnlineOptions"),
        "recursion": ("Recursion",),
    },
)
