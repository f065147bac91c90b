"""A bag before the monitor, as it would have come on the machine."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.history import Added, Sums, of_block, summed
from crane_observer.monitor.tolerance import Tolerance
from crane_observer.monitor.trim import TERMS
from crane_observer.monitor.watching import Heed, SensorWatch
from crane_observer.recording import COMMAND, ENCODERS, HeardRecording


class WatchedBag(NamedTuple):
    """What came out."""

    bag: Path
    joints: tuple[str, ...]
    findings: tuple[SensorFinding, ...]
    sums: Sums  # of the whole bag
    taken: Array  # (n, c) share of the tolerance, by channel and block
    refused: int
    why_not: str
    notes: tuple[str, ...] = ()  # what was mended when the bag was read

    @property
    def largest(self) -> float:
        """Share of the tolerance that was taken at most."""
        return float(self.taken.max(initial=0.0))


def watch(bag: Path, model: Model, tolerance: Tolerance | None) -> WatchedBag:
    """`DataError` names what the bag lacks."""
    return compare(HeardRecording.read(bag, model.joints), model, tolerance)


def compare(recording: HeardRecording, model: Model, tolerance: Tolerance | None) -> WatchedBag:
    """The same of what was read."""
    watched = SensorWatch(model, tolerance)
    monitor, taken = watched.monitor, []
    blocks: list[Added] = []
    for kind, row in recording.events():
        if kind == COMMAND:
            watched.add_command(float(recording.command_time[row]), recording.commands[row])
            continue
        if kind == ENCODERS:
            watched.add_encoders(float(recording.encoder_time[row]), recording.encoders[row])
        else:
            watched.add_pressures(
                float(recording.pressure_time[row]),
                recording.chamber_a[row],
                recording.chamber_b[row],
                float(recording.supply[row]),
            )
        if (block := monitor.take_block()) is not None:
            blocks.append(of_block(block))
            taken.append((block.time, monitor.taken))
    if model.hydraulics is None and watched.condition is Heed.ALONE:
        nothing = np.zeros((0, 2 * len(model.joints) + 1))
        sums = Sums(np.zeros(0), *(nothing,) * 5, np.zeros((*nothing.shape, TERMS)))
    elif not blocks:
        why = watched.last_refusal or Heed.WAITING.value
        raise DataError(f"{recording.path}: nothing could be compared: {why}")
    else:
        sums = summed([time for time, _ in taken], blocks)
    return WatchedBag(
        bag=recording.path,
        joints=model.joints,
        findings=tuple(monitor.findings),
        sums=sums,
        taken=np.array([shares for _, shares in taken]),
        refused=watched.refused,
        why_not=watched.last_refusal,
        notes=recording.notes,
    )
