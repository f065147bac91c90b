"""Where the tip of a machine can get, as lines to draw."""

from functools import cache

import numpy as np

from crane_model.inspection.findings import poses
from crane_model.kinematics import tip_position
from crane_model.machine import Machine

POSES = 200_000
AT_A_LIMIT = 1 / 3  # share of the joints of a pose: there, most of the boundary is reached
BANDS = 60  # of height, or of direction
SEED = 0


@cache
def reached_places(machine: Machine) -> np.ndarray:
    """(n, 3) places of the tip within the limits, many of them on the boundary [m]."""
    generator = np.random.default_rng(SEED)
    low, _, high = poses(machine)
    q = generator.uniform(low, high, (POSES, len(low)))
    at_limit = generator.random(q.shape) < AT_A_LIMIT
    limit = np.where(generator.random(q.shape) < 0.5, low, high)
    return tip_position(machine, np.where(at_limit, limit, q))


def side_outline(places: np.ndarray) -> np.ndarray:
    """(m, 2) closed outline of places (n, 3), seen along the ground: radius and height [m].

    >>> places = np.array([[1.0, 0.0, 0.0], [0.0, 3.0, 0.0], [2.0, 0.0, 1.0]])
    >>> side_outline(places)[:, 0].tolist()  # out along the outer side, back along the inner one
    [3.0, 2.0, 2.0, 1.0, 3.0]
    """
    radius, height = np.hypot(places[:, 0], places[:, 1]), places[:, 2]
    band = _bands(height, height.min(), height.max())
    present = np.unique(band)
    centre = height.min() + (present + 0.5) * (np.ptp(height) or 1.0) / BANDS
    inner = np.array([radius[band == one].min() for one in present])
    outer = np.array([radius[band == one].max() for one in present])
    out, back = np.stack([outer, centre], axis=1), np.stack([inner, centre], axis=1)[::-1]
    return np.concatenate([out, back, out[:1]])


def ground_arc(places: np.ndarray) -> np.ndarray:
    """(m, 2) farthest places (n, 3) in every direction that is reached, seen from above [m]."""
    angle, radius = np.arctan2(places[:, 1], places[:, 0]), np.hypot(places[:, 0], places[:, 1])
    band = _bands(angle, -np.pi, np.pi)
    present = np.unique(band)
    centre = -np.pi + (present + 0.5) * 2.0 * np.pi / BANDS
    gap = int(np.argmax(np.diff(centre, append=centre[0] + 2.0 * np.pi))) + 1
    centre = np.roll(centre, -gap)  # the line begins where the widest gap ends
    farthest = np.array([radius[band == one].max() for one in np.roll(present, -gap)])
    return farthest[:, None] * np.stack([np.cos(centre), np.sin(centre)], axis=1)


def _bands(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n,) whole numbers from 0 to `BANDS` - 1."""
    share = (values - low) / ((high - low) or 1.0)
    bands: np.ndarray = np.minimum((share * BANDS).astype(int), BANDS - 1)
    return bands
