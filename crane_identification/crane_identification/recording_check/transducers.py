"""Transducers that stop: clipped at the end of their range, or stuck."""

from collections.abc import Iterator

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import sampling_rate
from crane_identification.notation import spoken
from crane_identification.recording_check.constants import (
    ENDLESS,
    FROZEN,
    PLATEAU,
    RARELY,
    SPEED_OVER,
)
from crane_identification.recording_check.suspicion import Suspicion
from crane_identification.signals.motion import encoder_resolution

CAUSES = {
    "highest": "clipped at the end of its range",
    "lowest": "an empty chamber, or clipped at the lower end of its range",
    "": "the transducer is stuck",
}


def transducers(log: Log) -> Iterator[Suspicion]:
    """Readings that stay the same while the joint moves; needs neither units nor a machine."""
    for name, signal in (
        ("chamber A", log.pressure_a),
        ("chamber B", log.pressure_b),
        ("force", log.force if log.pressure_a is None else None),
    ):
        if signal is None:
            continue
        for j, joint in enumerate(log.joints):
            known = np.isfinite(signal.value[:, j])
            time, value = signal.time[known], signal.value[known, j]
            if len(value) > 1:
                moves = _moves(log, j, time)
                yield from _still(f"{spoken(joint)}, {name}", time, value, moves)


def _moves(log: Log, j: int, time: np.ndarray) -> np.ndarray:
    """(n,) whether the joint moves by more than two counts around these times."""
    known = np.isfinite(log.position.value[:, j])
    at, q = log.position.time[known], log.position.value[known, j]
    step = encoder_resolution(q[:, np.newaxis])[0]
    ahead, behind = (np.interp(time + side, at, q) for side in (SPEED_OVER / 2, -SPEED_OVER / 2))
    return np.abs(ahead - behind) > 2.0 * step


def _still(
    where: str, time: np.ndarray, value: np.ndarray, moves: np.ndarray
) -> Iterator[Suspicion]:
    edges = np.flatnonzero(np.diff(value, prepend=np.nan) != 0.0)
    moved = np.add.reduceat(moves, edges)  # samples in motion at each reading
    if not moves.any():
        return
    usual = np.percentile(moved[moved > 0], 95)
    if len(moved) == 1:  # nothing to compare it with
        usual = 1.0
    long = moved > max(PLATEAU * sampling_rate(time), RARELY * usual)
    if not long.any():
        return
    share = moved[long].sum() / moves.sum()
    level = value[edges[np.flatnonzero(long)[moved[long].argmax()]]]
    seconds = moved[long].max() / sampling_rate(time)
    returns = moved[long].max() < ENDLESS * moves.sum()
    end = {value.max(): "highest", value.min(): "lowest"}.get(level, "") if returns else ""
    evidence = (
        f"{share:.1%} of the motion at one reading, {level:.6g}"
        f"{f', the {end} of all' if end else ''}, for up to {seconds:.2g} s"
    )
    cause = CAUSES[end]
    yield Suspicion(where, evidence, cause, decisive=bool(share > FROZEN) and end != "lowest")
