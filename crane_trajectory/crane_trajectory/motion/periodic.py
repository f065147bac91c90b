"""Periodic trajectories of every kind, as a motion runs them and as files hold them."""

from pathlib import Path
from typing import Any, Protocol

import numpy as np

from crane_model.configuration import read_document
from crane_trajectory.motion.fourier import FourierTrajectory, Instants, MotionSamples
from crane_trajectory.motion.probe import Probe
from crane_trajectory.motion.sweep import SweepTrajectory


class PeriodicTrajectory(Protocol):
    """A periodic motion of some joints; the others are held."""

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def period(self) -> float:
        """[s]."""

    @property
    def harmonics(self) -> int:
        """Number of harmonics of (32) that its finest details correspond to."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the columns of `evaluate`."""

    @property
    def probe(self) -> Probe | None:
        """What is added to the commands, if anything."""

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Position, velocity and acceleration at any time (n,) [s]."""


def instants(trajectory: PeriodicTrajectory) -> Instants:
    """Return what gives the rows of `evaluate` (3, j) at one time [s]: compiled, if it can be."""
    if isinstance(trajectory, FourierTrajectory | SweepTrajectory):
        return trajectory.instants()
    return lambda time: np.concatenate(trajectory.evaluate(np.array([time])))


def load_trajectory(path: Path | str) -> FourierTrajectory | SweepTrajectory:
    """The trajectory of a YAML file; `ConfigurationError` if it is wrong.

    `kind: sweep` marks sweeps and dwells; without a kind it is a Fourier series (32).
    """
    document = read_document(path)
    return document.validated(schema_of(document.content))


def schema_of(content: Any) -> type[FourierTrajectory] | type[SweepTrajectory]:
    """Of the plain content of a trajectory file."""
    sweep = isinstance(content, dict) and content.get("kind") == "sweep"
    return SweepTrajectory if sweep else FourierTrajectory
