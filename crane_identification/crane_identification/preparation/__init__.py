"""From recordings to the records that a model is evaluated on."""

from typing import TYPE_CHECKING

from crane_identification.lazy import importer

if TYPE_CHECKING:
    from crane_identification.preparation.periodicity import Periodicity as Periodicity
    from crane_identification.preparation.periodicity import (
        detect_periodicity as detect_periodicity,
    )
    from crane_identification.preparation.run import Averaging as Averaging
    from crane_identification.preparation.run import Drift as Drift
    from crane_identification.preparation.run import Preparation as Preparation
    from crane_identification.preparation.session import Session as Session
    from crane_identification.preparation.session import prepare_all as prepare_all

_HOMES = {
    "Averaging": "run",
    "Drift": "run",
    "Periodicity": "periodicity",
    "Preparation": "run",
    "Session": "session",
    "detect_periodicity": "periodicity",
    "prepare_all": "session",
}
__all__ = sorted(_HOMES)
__getattr__ = importer(__name__, _HOMES)
