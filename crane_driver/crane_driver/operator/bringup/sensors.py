"""What bring-up measures of sensors: zero and sign of an encoder, offset of a transducer."""

from typing import Literal

import numpy as np

from crane_driver.operator.bringup.samples import SINKING, Rest
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

# Zero and sign of an encoder, from a known pose and a movement in the positive direction.

SMALLEST = 10.0  # movements that surely are none of noise: what a sign is told from
SCALE_TOLERANCE = 0.05  # by which a second known pose may contradict the first


class EncoderResult(ResultPart):
    """Of an encoder: joint = sign * (reading - zero)."""

    sign: Literal[-1, 1]
    """Of the encoder [-]."""
    zero: float
    """Reading where the joint stands at 0 [rad, m]."""
    noise: float
    """Standard deviation of one reading [rad, m]."""
    resolution: float
    """Of the readings [rad, m]."""
    moved: float
    """Way by the readings, in the positive direction [rad, m]."""
    scale: float | None = None
    """Way by the readings over way by the second known pose; absent without one [-]."""
    sinking: float
    """In the positive direction, at the known pose [rad/s, m/s]."""


def find_encoder(
    joint: str,
    rest: Rest,
    known: float,
    moved: float,
    way: float,
    moved_to: float | None = None,
) -> EncoderResult:
    """Zero and sign of the encoder of `joint`.

    rest: readings at the pose where the joint is known to be at `known` [rad, m]
    moved: by the readings, by how much it was moved from there in its positive direction [rad, m]
    way: by the readings, from there to the end, with what it sank meanwhile [rad, m]
    moved_to: where it is known to be at the end [rad, m]
    `DataError` if the movement was too small to tell it from noise, or contradicts `moved_to`.
    """
    smallest = SMALLEST * rest.movement
    if abs(moved) < smallest:
        raise DataError(
            f"{joint}: the encoder was moved by {abs(moved):.3g}, at least {smallest:.3g} tells "
            f"the direction; move the joint further, faster than {SINKING:g} per second (slower, "
            "it counts as sinking), and no other one"
        )
    sign: Literal[-1, 1] = 1 if moved > 0 else -1
    scale = None
    if moved_to is not None:
        if abs(moved_to - known) < smallest:
            raise DataError(
                f"{joint}: moved from {known:.4g} to {moved_to:.4g}, at least {smallest:.3g} "
                "tells the scale; move it further, and check the two values"
            )
        scale = sign * way / (moved_to - known)
        if scale <= 0.0:
            raise DataError(
                f"{joint}: moved from {known:.4g} to {moved_to:.4g}, which is not the direction "
                "in which it was moved; move it in its positive direction, and check the two values"
            )
        if abs(scale - 1.0) > SCALE_TOLERANCE:
            raise DataError(
                f"{joint}: the encoder shows {sign * way:.4g}, but the joint moved by "
                f"{moved_to - known:.4g}: a ratio of {scale:.3f}, allowed 1 ± {SCALE_TOLERANCE}; "
                "check unit and scale of the signal in the DBC, the gear of the encoder, and the "
                "two values"
            )
    return EncoderResult(
        sign=sign,
        zero=rest.position - sign * known,
        noise=rest.noise,
        resolution=rest.resolution,
        moved=sign * way,
        scale=scale,
        sinking=sign * rest.sinking,
    )


# The offset of a pressure transducer whose chamber is open to the air.

LARGEST_OFFSET = 1.0e6  # Pa; more is a pressure, or a transducer that is broken
LARGEST_SPREAD = 5.0e4  # Pa, standard deviation of readings at rest
LARGEST_DRIFT = 2.0e4  # Pa between the halves of the record


class PressureResult(ResultPart):
    """Of a transducer that is vented."""

    offset: float
    """Mean reading [Pa]."""
    spread: float
    """Standard deviation of one reading [Pa]."""
    std: float
    """Standard deviation of the offset [Pa]."""
    stuck: bool
    """Whether all readings are the same: at the end of the range, or not alive."""


def find_offset(name: str, readings: np.ndarray) -> PressureResult:
    """Offset of one transducer from readings (n,) [Pa] with its chamber vented.

    `DataError` if the pressure was not at rest, or too far from that of the air for an offset.
    """
    offset, spread = float(np.mean(readings)), float(np.std(readings))
    half = len(readings) // 2
    drift = abs(float(np.mean(readings[half:]) - np.mean(readings[:half])))
    if not np.isfinite(offset):
        raise DataError(f"{name}: some of its readings are missing; see /diagnostics")
    if abs(offset) > LARGEST_OFFSET:
        raise DataError(
            f"{name} reads {offset / 1e5:.2f} bar, an offset is at most "
            f"{LARGEST_OFFSET / 1e5:g} bar; the chamber is not vented: stop the engine, lower the "
            "crane onto its supports and let the pressure off"
        )
    if spread > LARGEST_SPREAD or drift > LARGEST_DRIFT:
        raise DataError(
            f"{name} is not at rest: spread {spread / 1e5:.2f} bar, limit "
            f"{LARGEST_SPREAD / 1e5:g}; drift {drift / 1e5:.2f} bar, limit "
            f"{LARGEST_DRIFT / 1e5:g}; wait, and measure again"
        )
    stuck = bool(np.ptp(readings) == 0.0)
    return PressureResult(
        offset=offset, spread=spread, std=spread / np.sqrt(len(readings)), stuck=stuck
    )
