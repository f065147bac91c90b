"""From recordings to the records that a model is evaluated on."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_identification.preparation.periodicity import Periodicity as Periodicity
    from crane_identification.preparation.periodicity import (
        detect_periodicity as detect_periodicity,
    )
    from crane_identification.preparation.prepare import Session as Session
    from crane_identification.preparation.prepare import prepare_all as prepare_all
    from crane_identification.preparation.run import Averaging as Averaging
    from crane_identification.preparation.run import Drift as Drift
    from crane_identification.preparation.run import Preparation as Preparation

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "periodicity": ("Periodicity", "detect_periodicity"),
        "prepare": ("Session", "prepare_all"),
        "run": ("Averaging", "Drift", "Preparation"),
    },
)
