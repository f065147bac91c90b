"""The scale over a recording: the same numbers as while it was made."""

import numpy as np

from crane_observer.recording import ENCODERS, PRESSURES, HeardRecording
from crane_observer.scale.scale import Scale, Weighing


def weigh(scale: Scale, recording: HeardRecording, tared: float = np.nan) -> list[Weighing]:
    """Feed it the recording; tare at `tared` [s], NaN: never."""
    found: list[Weighing] = []
    for kind, k in recording.events():
        if kind == ENCODERS:
            scale.add_encoders(float(recording.encoder_time[k]), recording.encoders[k])
        elif kind == PRESSURES:
            time = float(recording.pressure_time[k])
            if time >= tared:
                scale.tare()
                tared = np.nan
            found += scale.add_pressures(time, recording.chamber_a[k], recording.chamber_b[k])
    return found
