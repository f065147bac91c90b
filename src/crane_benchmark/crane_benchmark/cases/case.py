"""A case of the benchmark, and the recordings of its session."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from enum import StrEnum

import numpy as np
from pydantic import ConfigDict

from crane_benchmark.cases.motions import Richness
from crane_model.configuration import Schema
from crane_model.result_file import ResultFile
from crane_sim.effects.form import InjectedForm
from crane_sim.ground_truth import TrueEffect
from crane_sim.make_bag import COLD, STARTED, Moment
from crane_trajectory.motion.motion import Motion

TRAIN, VALIDATE = "train", "validate"
PAUSE = (60.0, 420.0)  # s, between two recordings of a session
WARM = (600.0, 1800.0)  # s for which the machine has worked before a session begins warm
YEAR = 365 * 86400  # s


class CaseKind(StrEnum):
    """Kind of a case; tables print the value."""

    NOTHING = "nothing"
    OUTSIDE = "outside the catalogue"
    PAIR = "pair"
    AMBIGUOUS = "ambiguous"  # effects that no data of this kind discriminate
    INSUFFICIENT = "too little data"
    LENGTHS = "lengths that are not the file's"  # nothing else is hidden
    SINGLE = "single"


class Simulator(StrEnum):
    """Whose machine makes the recordings of a case."""

    PRIMARY = "primary"  # crane_sim, which the diagnosis was developed on
    INDEPENDENT = "independent"  # of other make, with model forms of its own


class World(StrEnum):
    """Source of a case."""

    LABORATORY = "laboratory"  # designed motions; each recording is of a cold machine
    FIELD = "field"  # motions as they come, some without a period; recordings of one session


class Carried(StrEnum):
    """Which recordings of a case carry an effect."""

    ALL = "all"
    LATER = "later"  # half of those to train on


class EffectToHide(Schema):
    """An effect to hide in a form that the machines of its simulator have."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    effect: str
    """Its type in the catalogue, or in that of the simulated crane."""
    joint: str | None
    """The joint; null: the whole machine."""
    form: str
    """Law that it follows in the machine."""
    relative_magnitude: float
    """Rms of its force over that of the drive, that is asked for [-]."""
    carried: Carried = Carried.ALL
    """Which recordings carry it."""


class HiddenInRecording(ResultFile):
    """Injected effects of one recording of a case."""

    effects: list[TrueEffect]
    """As in a label."""


class Case(Schema):
    """One case. `seed` is that of machine, motions and sensors; `lacks` are types of terms that
    the model to diagnose lacks on the telescope.

    A machine that is `off` is up to 3 % longer or shorter, link by link, than its file says; others
    were surveyed. Its valves have equal edges, or `spools` made for differential cylinders. In the
    field, the session begins with oil that is `warm` or cold.
    """

    name: str  # tells nothing
    kind: CaseKind
    simulator: Simulator = Simulator.PRIMARY
    seed: tuple[int, int]
    effects: tuple[EffectToHide, ...] = ()
    excitation: Richness = Richness.RICH
    lacks: tuple[str, ...] = ()
    world: World = World.LABORATORY
    warm: bool = False
    spools: bool = False
    off: bool = False


# The recordings of a case: when each was made, and which of the hidden effects it carries.


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

    def present(self, injected: Sequence[InjectedForm]) -> tuple[InjectedForm, ...]:
        return tuple(
            effect._replace(values=(share * effect.values[0], *effect.values[1:]))
            for effect, share in zip(injected, self.shares, strict=True)
            if share
        )


def recordings(
    rng: np.random.Generator, case: Case, train: Sequence[Motion], validate: Sequence[Motion]
) -> list[SessionRecording]:
    """Those of a case, by name; in the field they were made in any other order."""
    motions = [*train, *validate]
    moments = _session(rng, case.warm, motions) if case.world is World.FIELD else None
    shares = [_shares(effect.carried, len(train), len(validate)) for effect in case.effects]
    return [
        SessionRecording(
            part=TRAIN if k < len(train) else VALIDATE,
            number=k if k < len(train) else k - len(train),
            motion=motion,
            moment=moments[k] if moments else COLD,
            shares=tuple(float(of_effect[k]) for of_effect in shares),
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


def _shares(carried: Carried, train: int, validate: int) -> np.ndarray:
    """(train + validate,) of the magnitude of an effect, in each recording."""
    shares = np.ones(train + validate)
    if carried is Carried.LATER:
        shares[: train // 2] = 0.0
        shares[train:] = 0.0
    return shares
