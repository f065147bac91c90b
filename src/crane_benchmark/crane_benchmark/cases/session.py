"""The recordings of a case: when each was made, and which of the hidden effects it carries."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from crane_benchmark.cases.case import Carried, Case, World
from crane_sim.effects.form import Planted
from crane_sim.make_bag import COLD, STARTED, Moment
from crane_trajectory.motion.motion import Motion

TRAIN, VALIDATE = "train", "validate"
PAUSE = (60.0, 420.0)  # s, between two recordings of a session
WARM = (600.0, 1800.0)  # s for which the machine has worked before a session begins warm
YEAR = 365 * 86400  # s
LIGHTER = (0.4, 0.8)  # of the strongest: an effect that is not always as strong


@dataclass(frozen=True)
class SessionRecording:
    """One of those to train or to validate on, by its `number` there.

    `shares` are those of the magnitudes of the hidden effects, 0 where it does not carry one.
    """

    part: str
    number: int
    motion: Motion
    moment: Moment
    shares: tuple[float, ...]

    def present(self, planted: Sequence[Planted]) -> tuple[Planted, ...]:
        """What it carries of the effects of the machine."""
        return tuple(
            effect._replace(values=(share * effect.values[0], *effect.values[1:]))
            for effect, share in zip(planted, self.shares, strict=True)
            if share
        )


def recordings(
    rng: np.random.Generator, case: Case, train: Sequence[Motion], validate: Sequence[Motion]
) -> list[SessionRecording]:
    """Those of a case, by name; in the field they were made in any other order."""
    motions = [*train, *validate]
    moments = _session(rng, case.warm, motions) if case.world is World.FIELD else None
    shares = [_shares(rng, one.carried, len(train), len(validate)) for one in case.effects]
    return [
        SessionRecording(
            part=TRAIN if k < len(train) else VALIDATE,
            number=k if k < len(train) else k - len(train),
            motion=motion,
            moment=moments[k] if moments else COLD,
            shares=tuple(float(one[k]) for one in shares),
        )
        for k, motion in enumerate(motions)
    ]


def _session(rng: np.random.Generator, warm: bool, motions: Sequence[Motion]) -> list[Moment]:
    """One day at the machine: recordings in random order, with pauses in which it stays on."""
    started = STARTED + timedelta(seconds=int(rng.integers(YEAR)))
    running = rng.uniform(*WARM) if warm else rng.uniform(*PAUSE) / 10.0
    moments = [COLD] * len(motions)
    for k in rng.permutation(len(motions)):
        moments[k] = Moment(started, round(running, 3))
        running += motions[k].duration + rng.uniform(*PAUSE)
    return moments


def _shares(rng: np.random.Generator, carried: Carried, train: int, validate: int) -> np.ndarray:
    """(train + validate,) of the magnitude of an effect, in each recording."""
    shares = np.ones(train + validate)
    if carried is Carried.LATER:
        shares[: train // 2] = 0.0
        shares[train:] = 0.0
    elif carried is Carried.ONE:
        shares[:] = 0.0
        shares[rng.integers(train)] = 1.0
    elif carried is Carried.SOME:
        levels = np.array([1.0, rng.uniform(*LIGHTER) if rng.uniform() < 0.5 else 1.0])
        on = rng.uniform(size=len(shares)) < 0.5
        first = rng.permutation(train)[:2]
        on[first] = True, False  # it shows at all in those to train on
        shares = on * rng.choice(levels, len(shares))
    return shares
