"""What a recording would show without noise: the scorer's own measure of what is hidden."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crane_benchmark.cases.motions import PLANAR, PLANAR_JOINTS
from crane_model.record import Record
from crane_sim.hiding.calibrate import SLEW
from crane_sim.hiding.label import Clean
from crane_sim.parts.parameters import load_stand_in

EVERY = 4  # of the samples of a bag, that are kept
SPEED = 2e-3  # rad/s, m/s, below which a joint counts as at rest: dry friction may be any force
COUNTS = 2  # of its encoder, that a joint must have moved since it turned: one there, one here


def save_clean(path: Path, clean: Clean) -> None:
    """Every fourth sample of what the scorer needs."""

    def planar(values: np.ndarray) -> np.ndarray:
        return values[..., ::EVERY, :][..., PLANAR]

    slew = (clean.position, clean.velocity, clean.acceleration)
    np.savez_compressed(
        path,
        time=clean.time[::EVERY],
        position=planar(clean.seen_position),
        velocity=planar(clean.velocity),
        acceleration=planar(clean.acceleration),
        pressure_a=planar(clean.pressure_a),
        pressure_b=planar(clean.pressure_b),
        force=planar(clean.seen_drive),
        hidden=planar(clean.force),
        way=planar(_way(clean.seen_position, clean.velocity)),
        slew=np.stack([values[::EVERY, SLEW] for values in slew]),
    )


@dataclass(frozen=True)
class Seen:
    """Recordings of a case without noise: n samples of j joints.

    `hidden` (k, n, j): the part of each effect in the force; `used` (n, j): where a joint moves
    and encoders tell which way.
    """

    record: Record
    hidden: np.ndarray
    used: np.ndarray

    def rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of values (n, j) over the used samples."""
        power = (np.where(self.used, values, 0.0) ** 2).sum(axis=0)
        return np.sqrt(power / np.maximum(self.used.sum(axis=0), 1))


def load_seen(paths: Sequence[Path], effects: Sequence[Sequence[int]], count: int) -> Seen:
    """The recordings in `paths`; the rows of `hidden` in each are those of `effects` of `count`."""
    parts: dict[str, list[np.ndarray]] = {}
    hidden, runs = [], []
    for number, (path, own) in enumerate(zip(paths, effects, strict=True)):
        with np.load(path) as file:
            for name in file.files:
                parts.setdefault(name, []).append(file[name])
            whole = np.zeros((count, *file["force"].shape))
            whole[list(own)] = file["hidden"]
        hidden.append(whole)
        runs.append(np.full(len(parts["time"][-1]), number))
    slew = np.concatenate(parts["slew"], axis=1)

    def joined(name: str) -> np.ndarray:
        return np.concatenate(parts[name])

    record = Record(
        joints=PLANAR_JOINTS,
        time=joined("time"),
        position=joined("position"),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        run=np.concatenate(runs),
        force=joined("force"),
        pressure_a=joined("pressure_a"),
        pressure_b=joined("pressure_b"),
        slew_position=slew[0],
        slew_velocity=slew[1],
        slew_acceleration=slew[2],
    )
    steps = load_stand_in().sensors.encoder_resolution
    seen = joined("way") > COUNTS * np.array([steps[joint] for joint in PLANAR_JOINTS])
    used = seen & (np.abs(record.velocity) > SPEED)
    return Seen(record, np.concatenate(hidden, axis=1), used)


def _way(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(n, j) how far each joint has moved since it last turned, or since the recording began.

    Of all samples of a recording: where friction is carried by bristles, a joint that comes to rest
    trembles at some 30 Hz, which every fourth of them would hide.
    """
    ways = np.sign(velocity)
    turned = np.ones(ways.shape, dtype=bool)
    turned[1:] = ways[1:] != ways[:-1]
    number = np.arange(len(ways))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(turned, number, 0), axis=0)
    return np.abs(position - np.take_along_axis(position, last, axis=0))
