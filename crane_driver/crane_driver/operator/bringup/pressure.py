"""The offset of a pressure transducer whose chamber is open to the air."""

import numpy as np

from crane_model.errors import DataError
from crane_model.result_file import ResultPart

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
