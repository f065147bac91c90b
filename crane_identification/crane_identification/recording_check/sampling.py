"""How often signals were sampled, and whether old samples were sent again."""

from collections.abc import Iterator

import numpy as np

from crane_identification.data.log import Log, Signal
from crane_identification.data.resample import sampling_rate
from crane_identification.notation import spoken
from crane_identification.recording_check.constants import (
    HELD,
    HELD_COUNTS,
    LEAST_RATE,
    SLOWEST,
    SPEED_OVER,
)
from crane_identification.recording_check.suspicion import Suspicion
from crane_identification.signals.motion import encoder_resolution


def sampling(log: Log) -> Iterator[Suspicion]:
    """What is suspicious of the rates of a crane's signals."""
    force = log.force or log.pressure_a
    for signal in (log.position, force):
        if signal is not None and (rate := sampling_rate(signal.time)) < SLOWEST:
            yield Suspicion(
                signal.origin,
                f"{rate:.3g} samples a second, at least {SLOWEST:g} needed",
                "too slow for accelerations and for the swinging of the crane; record faster",
                decisive=rate < LEAST_RATE,
            )
    yield from _held(log.position, log.joints)


def _held(signal: Signal, joints: tuple[str, ...]) -> Iterator[Suspicion]:
    """Positions that stand still for some samples, and then jump."""
    rate = sampling_rate(signal.time)
    span = max(1, round(SPEED_OVER * rate))
    resolution = encoder_resolution(signal.value[np.isfinite(signal.value).all(axis=1)])
    for joint, value, step in zip(joints, signal.value.T, resolution, strict=True):
        travel = np.abs(value[2 * span :] - value[: -2 * span]) / (2 * span)  # a sample
        moves = travel > HELD_COUNTS * step
        repeated = (np.diff(value) == 0.0)[span : span + len(moves)][moves]
        if len(repeated) > span and repeated.mean() > HELD:
            fresh = rate * (1.0 - repeated.mean())
            yield Suspicion(
                spoken(joint),
                f"{repeated.mean():.0%} of the positions in motion repeat the one before",
                f"measured {fresh:.0f} times a second, and sent again {rate:.0f} times",
                decisive=fresh < SLOWEST,
            )
