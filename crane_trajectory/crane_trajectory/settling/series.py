"""Random Fourier series (32) within the limits, and others near one of them."""

from dataclasses import dataclass

import numpy as np

from crane_trajectory.excitation.problem import DECIMALS, ExcitationProblem
from crane_trajectory.motion.fourier import FourierTrajectory

SHARES = (1.0, 0.97, 0.9, 0.8)  # of a series, tried in turn until it is within the limits
VARIATION = 0.25  # of a series, rms over that of its waves


@dataclass(frozen=True)
class FourierDraws:
    """Of the period and harmonics of a problem."""

    problem: ExcitationProblem

    def draw(self, rng: np.random.Generator) -> FourierTrajectory | None:
        """One that is within the limits; None if the one that was drawn is not."""
        return self._checked(self.problem.random_point(rng))

    def varied(
        self, trajectory: FourierTrajectory, rng: np.random.Generator
    ) -> FourierTrajectory | None:
        """Another one near it; None if that is not within the limits."""
        point = trajectory.coefficients
        size = np.sqrt((point[1:] ** 2).mean(axis=0))
        wave = np.concatenate([[1.0], *[1.0 / np.arange(1, self.problem.harmonics + 1)] * 2])
        change = VARIATION * size * wave[:, None] * rng.standard_normal(point.shape)
        return self._checked(self.problem.start_limits.mend((point + change).ravel()))

    def _checked(self, point: np.ndarray) -> FourierTrajectory | None:
        problem = self.problem
        for share in SHARES:
            drawn = np.round(self.problem.start_limits.drawn_home(point, share), DECIMALS)
            trajectory = FourierTrajectory.from_coefficients(
                "settling", problem.period, problem.model.joints, drawn.reshape(problem.shape)
            )
            if not problem.check(trajectory):
                return trajectory
        return None
