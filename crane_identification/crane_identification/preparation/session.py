"""Recordings prepared in the time of their session: oil that warms up does so in pauses as well."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Self

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.log import Log
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_model.errors import DataError, NoMotionError
from crane_model.model_file import Model
from crane_model.progress import Progress, silent

TOUCHING = 1.0  # s by which recordings of one session may overlap, as parts of one that was split
COOLED = 4 * 3600.0  # s of a pause after which the machine is cold again: another session


@dataclass(frozen=True)
class Session:
    """`start` [ns] of the session of each recording, by its source, on the clock of the recordings.

    `fallback` says why the stamps are no common clock, so that each recording is a session of its
    own; None if they are one.
    """

    start: dict[str, int]
    fallback: str | None

    @classmethod
    def of(cls, logs: Sequence[Log]) -> Self:
        """The sessions that recordings belong to, in whatever order they are given."""
        ordered = chronological(logs)
        begins = {log.source: log.start for log in ordered}
        for before, after in pairwise(ordered):
            pause = (after.start - before.start) / NANOSECONDS - _length(before)
            if pause < -TOUCHING:
                return cls(
                    dict(begins),
                    f"the stamps of {before.source} and {after.source} overlap, so time counts "
                    "from the start of each recording",
                )
            if pause < COOLED:
                begins[after.source] = begins[before.source]
        return cls(begins, None)

    def since(self, log: Log) -> float:
        """From the start of its session to time zero of a recording [s]."""
        return (log.start - self.start[log.source]) / NANOSECONDS


def prepare_all(
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress = silent,
    session: Session | None = None,
) -> list[Preparation]:
    """`prepare` of each recording, in the time of the `session` (None: of these recordings).

    Raises `DataError` without recordings, and as `prepare`.
    """
    return [
        one
        for prepared in _one_by_one(model, logs, options, progress, session)
        for one in prepared()
    ]


def prepare_moving(
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress = silent,
    session: Session | None = None,
) -> tuple[list[Preparation], tuple[str, ...]]:
    """As `prepare_all`, without recordings in which no joint of the model moves, and the names of
    these. One in which only a joint outside the model moves tells of its valve all the same.

    Raises `NoMotionError` where none moves in any.
    """
    moving: list[Preparation] = []
    standing = []
    one_by_one = _one_by_one(model, logs, options, progress, session)
    for log, prepared in zip(logs, one_by_one, strict=True):
        with suppress(NoMotionError):
            in_motion = [one for one in prepared() if one.moving.any()]
            moving += in_motion
            if in_motion:
                continue
        standing.append(log.source)
    if not moving:
        raise NoMotionError(
            f"{', '.join(standing)}: no joint moves, of model '{model.name}', faster than its "
            "velocity can be told from standstill; record a motion"
        )
    return moving, tuple(standing)


def _one_by_one(
    model: Model,
    logs: Sequence[Log],
    options: Options,
    progress: Progress,
    session: Session | None,
) -> Iterator[Callable[[], list[Preparation]]]:
    if not logs:
        raise DataError(f"model '{model.name}': no recordings given; give at least one")
    session = session or Session.of(logs)
    for number, log in enumerate(logs):

        def partly(phase: str, done: float, number: int = number) -> None:
            progress(phase, (number + done) / len(logs))

        yield partial(prepare, model, log, options, partly, session.since(log))


def chronological(logs: Sequence[Log]) -> list[Log]:
    """By their first stamps, and where these are equal by name: the order given tells nothing."""
    return sorted(logs, key=lambda log: (log.start, log.source))


def _length(log: Log) -> float:
    """From time zero to the last position [s]."""
    return float(log.position.time[-1])
