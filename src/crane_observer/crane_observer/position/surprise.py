"""Whether innovations ask for another load: two-sided CUSUM of their projection on it."""

import math

import numpy as np

from crane_model.array import Array

SURPRISE = 5.0  # standard deviations of a load that comes or goes, in the sum over some windows
SLACK = 0.75  # of these, a window, that are no surprise
MOST = 2.5  # of these, a window, that count: one alone is no surprise
EXPLAINED = 0.6  # of the surprise, what a load must explain of it
FAR = 5.0  # standard deviations of each innovation, beyond which one is set aside
ASIDE = 3  # in a row; what stays is no slip of a sensor


class Surprise:
    """The sums of one filter, for more load and for less; replaced and never written to."""

    def __init__(self) -> None:
        self._sums = np.zeros(2)
        self._aside = 0  # of the last innovations
        self.suspected = False  # the last innovations ask for another load, or are outliers

    def add(self, load: Array, innovation: Array, covariance: Array) -> bool:
        """Innovations (r,) with their covariance (r, r), and what 1 kg more asks of them (r,)."""
        spread = np.linalg.solve(covariance, np.stack([load, innovation], 1))
        information = float(load @ spread[:, 0])
        self.suspected = False
        if information <= 0.0:
            return False
        away = float(load @ spread[:, 1]) / math.sqrt(information)
        if away**2 < EXPLAINED * float(innovation @ spread[:, 1]):
            away = 0.0  # something else
        signs = np.array([1.0, -1.0])
        self._sums = np.maximum(self._sums + np.clip(signs * away, -MOST, MOST) - SLACK, 0.0)
        if self._sums.max() < SURPRISE:
            far = float(innovation @ spread[:, 1]) > FAR**2 * len(innovation)
            self._aside = self._aside + 1 if far else 0
            self.suspected = abs(away) > MOST or (far and self._aside <= ASIDE)
            return False
        self._sums = np.zeros(2)
        return True
