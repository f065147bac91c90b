"""Encoders that freeze for a while, and joints that rest: only the former stop without inertia."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from crane_identification import Log, Signal
from crane_identification.recording_check.check import check
from crane_identification.recording_check.suspicion import Suspicion

STEP = 0.004  # s
TIME = np.arange(0.0, 24.0, STEP)
Encoder = Callable[[np.ndarray], np.ndarray]


def counts(resolution: float) -> Encoder:
    return lambda q: np.asarray(np.round(q / resolution) * resolution)


def noise(sigma: float) -> Encoder:
    rng = np.random.default_rng(7)
    return lambda q: q + sigma * rng.standard_normal(q.shape)


def log_of(position: np.ndarray) -> Log:
    """A table of positions (n, j), with forces of the masses, dry friction and a spring."""
    velocity = np.gradient(position, STEP, axis=0)
    force = np.gradient(velocity, STEP, axis=0) + 3.0 * np.tanh(50.0 * velocity) + 5.0 * position
    joints = tuple(f"axis_{j}" for j in range(1, position.shape[1] + 1))
    return Log("arm", joints, 0, Signal(TIME, position, "q"), force=Signal(TIME, force, "f"))


def of_encoders(log: Log) -> list[Suspicion]:
    return [found for found in check(None, log).suspicions if "encoder" in found.cause]


def swings() -> np.ndarray:
    """(n, 3) rad: three joints in motion."""
    return 0.7 * np.sin(TIME[:, np.newaxis] * (0.9, 1.3, 2.1) + (0.3, 1.1, 2.0))


def frozen(position: np.ndarray, begin: float, end: float) -> np.ndarray:
    out = position.copy()
    inside = (begin <= TIME) & (end > TIME)
    out[inside, 1] = out[np.flatnonzero(inside)[0], 1]
    return out


@pytest.mark.parametrize("encoder", [counts(1e-6), counts(1e-3), counts(5e-3), noise(2e-5)])
@pytest.mark.parametrize(("begin", "end"), [(8.0, 11.0), (0.0, 6.0), (5.0, 5.6)])
def test_a_frozen_encoder_that_jumps_back_is_wrong(
    encoder: Encoder, begin: float, end: float
) -> None:
    log = log_of(swings())
    read = frozen(encoder(log.position.value), begin, end)
    (found,) = of_encoders(replace(log, position=Signal(TIME, read, "q")))
    assert found.where == "axis 2" and found.decisive
    told = re.search(r"from (\S+) s to (\S+) s", found.evidence)
    assert told and [float(one) for one in told.groups()] == pytest.approx([begin, end], abs=0.02)


@pytest.mark.parametrize("encoder", [counts(1e-6), counts(1e-3), noise(2e-5)])
def test_an_encoder_that_freezes_for_good_is_doubtful(encoder: Encoder) -> None:
    """Or that counts on from where it froze: the joint may have hit a stop as well."""
    log = log_of(swings())
    good = encoder(log.position.value)
    inside = (TIME >= 12.0) & (TIME < 14.0)
    counting = good.copy()
    counting[:, 1] = np.cumsum(np.diff(good[:, 1], prepend=good[0, 1]) * ~inside)
    for read in (frozen(good, 12.0, np.inf), counting):
        (found,) = of_encoders(replace(log, position=Signal(TIME, read, "q")))
        assert found.where == "axis 2" and not found.decisive
    reference = Signal(TIME, log.position.value, "q_d")
    known = replace(log, position=Signal(TIME, frozen(good, 12.0, np.inf), "q"))
    (found,) = of_encoders(replace(known, reference_position=reference))
    assert found.decisive and "its reference moves" in found.evidence


def strokes(acceleration: float) -> np.ndarray:
    """(n,) rad: to and fro at 0.5 rad/s, ramps of constant acceleration, rests of 1 s."""
    inside = TIME % 3.0
    speed = np.clip(acceleration * np.minimum(inside, 2.0 - inside), 0.0, 0.5)
    return np.asarray(np.cumsum(np.where(TIME % 6.0 < 3.0, speed, -speed)) * STEP)


@pytest.mark.parametrize("encoder", [counts(1e-6), counts(1e-4), counts(1e-3), counts(5e-3)])
@pytest.mark.parametrize("acceleration", [1.0, 5.0, 20.0])
def test_a_joint_that_rests_is_right(encoder: Encoder, acceleration: float) -> None:
    position = swings()
    position[:, 1] = strokes(acceleration)
    log = log_of(position)
    assert not of_encoders(replace(log, position=Signal(TIME, encoder(position), "q")))


def test_a_joint_that_slides_to_a_rest_is_right() -> None:
    """It coasts against dry friction, rests while the others move, and is pushed on."""
    position, speed = swings(), 0.0
    for i, time in enumerate(TIME):
        drive = 4.0 * np.sin(1.4 * time)
        friction = 3.0 * np.sign(speed) if speed else np.clip(drive, -3.0, 3.0)
        ahead = speed + (drive - friction) * STEP
        speed = 0.0 if ahead * speed < 0.0 else ahead
        position[i, 1] = position[i - 1, 1] + speed * STEP if i else 0.0
    assert (np.diff(position[:, 1]) == 0.0).mean() > 0.1
    assert not of_encoders(log_of(position))
