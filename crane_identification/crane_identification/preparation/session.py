"""Recordings prepared in the time of their session: oil that warms up does so in pauses as well."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

from crane_bags.clocks import NANOSECONDS
from crane_identification.data.log import Log
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_model.errors import DataError
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
    if not logs:
        raise DataError(f"model '{model.name}': no recordings given; give at least one")
    session = session or Session.of(logs)
    out = []
    for number, log in enumerate(logs):

        def partly(phase: str, done: float, number: int = number) -> None:
            progress(phase, (number + done) / len(logs))

        out += prepare(model, log, options, partly, session.since(log))
    return out


def chronological(logs: Sequence[Log]) -> list[Log]:
    """By their first stamps, and where these are equal by name: the order given tells nothing."""
    return sorted(logs, key=lambda log: (log.start, log.source))


def _length(log: Log) -> float:
    """From time zero to the last position [s]."""
    return float(log.position.time[-1])
