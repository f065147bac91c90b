"""The signals of one run, and the records that they give along a motion."""

from dataclasses import replace

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples
from crane_identification.signals.gate import velocity_resolution
from crane_identification.signals.motion import Motion, encoder_resolution
from crane_model.cylinders import generalized_forces
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record

REFERENCE = ("reference_position", "reference_velocity", "reference_acceleration")
LOGGED = (
    *("pressure_a", "pressure_b", "supply_pressure", "tank_pressure"),
    *("slew_position", "command", "temperature"),
)


def signals_of(model: Model, samples: Samples, rows: np.ndarray) -> dict[str, np.ndarray]:
    """What a record holds besides time and motion, on the given rows; absent where not logged."""
    names = ("position", "force", *LOGGED, *REFERENCE)
    logged = {name: getattr(samples, name) for name in names}
    signals = {name: values[rows] for name, values in logged.items() if values is not None}
    if "force" not in signals:
        if model.machine is None or "pressure_a" not in signals:
            raise DataError(
                f"{samples.source}: holds neither generalized forces nor, with a machine in the "
                f"model, chamber pressures to compute them from (27); map or record one of them"
            )
        signals["force"] = generalized_forces(
            model.machine,
            signals["position"],
            signals["pressure_a"],
            signals["pressure_b"],
            model.joints,
        )
    return signals


def resolution_of(log: Log) -> np.ndarray:
    """Encoder resolution (coordinates,) of the readings as they were logged."""
    signals = [log.position] if log.slew_position is None else [log.position, log.slew_position]
    return np.concatenate(
        [encoder_resolution(signal.value.reshape(len(signal.time), -1)) for signal in signals]
    )


def coordinates(signals: dict[str, np.ndarray]) -> np.ndarray:
    """Positions of the joints and, last and where it is logged beside them, of the slew joint."""
    if "slew_position" not in signals:
        return signals["position"]
    return np.column_stack([signals["position"], signals["slew_position"]])


def along_reference(record: Record, signals: dict[str, np.ndarray]) -> Record | None:
    """`record` with the motion that was asked for, where all of it is known."""
    motion = [signals[name] for name in REFERENCE if name in signals]
    if len(motion) < len(REFERENCE) or not all(np.isfinite(values).all() for values in motion):
        return None
    position, velocity, acceleration = motion
    return replace(record, position=position, velocity=velocity, acceleration=acceleration)


def record_of(
    model: Model,
    time: np.ndarray,
    signals: dict[str, np.ndarray],
    motion: Motion,
    mask_reversals: bool,
) -> Record:
    """The record (n samples) of signals along an estimated motion.

    The last coordinate of the motion is the slew joint, where that was logged. Without
    `mask_reversals` every velocity counts as known.
    """
    joints = len(model.joints)
    record = Record(
        joints=model.joints,
        time=time,
        position=motion.position[:, :joints],
        velocity=motion.velocity[:, :joints],
        acceleration=motion.acceleration[:, :joints],
        force=signals["force"],
        pressure_a=signals.get("pressure_a"),
        pressure_b=signals.get("pressure_b"),
        supply_pressure=signals.get("supply_pressure"),
        tank_pressure=signals.get("tank_pressure"),
        command=signals.get("command"),
        temperature=signals.get("temperature"),
        velocity_resolution=velocity_resolution(motion)[:joints] if mask_reversals else None,
    )
    if "slew_position" not in signals:
        return record
    return replace(
        record,
        slew_position=motion.position[:, joints],
        slew_velocity=motion.velocity[:, joints],
        slew_acceleration=motion.acceleration[:, joints],
    )
