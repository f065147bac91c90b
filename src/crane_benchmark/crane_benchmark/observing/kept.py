"""Recordings of a machine at work, kept, so that a benchmark that was interrupted goes on."""

import os
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_observer.recording import HeardRecording


class HeardWork(NamedTuple):
    """What was heard of a machine at work."""

    begin: float  # s since the machine was started, where the times of `heard` count from
    heard: HeardRecording

    @property
    def seconds(self) -> float:
        """How long it is."""
        return float(np.ptp(self.heard.pressure_time))


ARRAYS = tuple(one.name for one in fields(HeardRecording))[2:]


class KeptRecordings:
    """In a folder, a file for each. They depend on the machine and its seeds, not on who watches;
    several processes may make different ones.
    """

    def __init__(self, folder: Path):
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder

    def recording(self, name: str, made: Callable[[], HeardWork]) -> HeardWork:
        """That of this name, made now unless it was before."""
        file = self.folder / f"{name}.npz"
        if not file.exists():
            work = made()
            unfinished = self.folder / f"{name}.unfinished.{os.getpid()}"
            with unfinished.open("wb") as stream:
                arrays = {key: getattr(work.heard, key) for key in ARRAYS}
                np.savez(stream, allow_pickle=False, begin=work.begin, **arrays)
            unfinished.replace(file)
            return work._replace(heard=replace(work.heard, path=file))
        with np.load(file) as kept:
            arrays = {key: kept[key] for key in ARRAYS}
            return HeardWork(float(kept["begin"]), HeardRecording(file, 0, **arrays))
