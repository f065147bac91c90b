"""Identification beside the running crane."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.online.estimator import OnlineEstimator as OnlineEstimator
    from crane_identification.online.estimator import OnlineOptions as OnlineOptions
    from crane_identification.online.recursion import Recursion as Recursion

_HOMES = {
    "OnlineEstimator": "estimator",
    "OnlineOptions": "estimator",
    "Recursion": "recursion",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
