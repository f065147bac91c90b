"""What makes a term a candidate for an effect that a model lacks."""

from typing import NamedTuple

import numpy as np


class Effect(NamedTuple):
    """A physical effect as people speak of it."""

    name: str
    signature: str  # how it shows in the residual of a model that lacks it
    confusable: tuple[str, ...]  # types of the terms that it is easily taken for
    settled_by: str  # the experiment that tells it from them
    kin: tuple[str, ...] = ()  # types of terms that are other laws of the same effect: one class
    law_of: str = ""  # type of the term that is the usual law of the same effect, if not this one


class Shape(NamedTuple):
    """A field of a term in which its force is not linear, and where its value is sought."""

    lowest: float
    highest: float
    unit: str
    points: int
    meaning: str

    @property
    def grid(self) -> np.ndarray:
        """(points,) from lowest to highest, in equal ratios."""
        return np.geomspace(self.lowest, self.highest, self.points)
