"""Zero and sign of an encoder, from a known pose and a movement in the positive direction."""

from typing import Literal

from crane_driver.operator.bringup.samples import SINKING, Rest
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

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
