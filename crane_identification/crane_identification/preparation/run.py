"""One run of a recording: its signals, and what is made of them for the regressor."""

from dataclasses import dataclass, replace

import numpy as np

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples
from crane_identification.options import Options
from crane_identification.signals.gate import SETTLING, moving, velocity_resolution
from crane_identification.signals.motion import SmoothedMotion, encoder_resolution
from crane_model.cylinders import generalized_forces
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.record import Record

REFERENCE = ("reference_position", "reference_velocity", "reference_acceleration")
LOGGED = (
    *("pressure_a", "pressure_b", "supply_pressure", "tank_pressure"),
    *("slew_position", "command", "temperature"),
)


@dataclass(frozen=True)
class Averaging:
    """How a recording was averaged.

    `period` [s]; `used` whole periods, the last ones; `transient` whole periods before them were
    left out, and `incomplete` [s] of the periodic part fills no whole period. `drift` of the force.
    """

    period: float
    used: int
    transient: int
    incomplete: float
    drift: "Drift"


@dataclass(frozen=True)
class Drift:
    """Steady change from period to period, per joint (j,); NaN for fewer than three periods.

    `rate`: root mean square change of the force a period [N m or N]. `p_value`: how likely scatter
    that is none would look so.
    """

    rate: np.ndarray
    p_value: np.ndarray


@dataclass(frozen=True)
class Preparation:
    """One run of a recording, ready for the regressor.

    `record`: n samples every `step` s with motion and generalized force; one averaged period if
    `averaging` is not None. `moving` (n, j): where the sign of the velocity is known, and
    friction has settled behind a reversal; `signed` (n, j): where the sign is known; of an average
    both hold in each of its periods. `bandwidth` (j,) [Hz] of the motion. `periods` (M, n, j): the
    generalized forces that were averaged. `reference`: the record along the motion that was asked
    for, None where it was not recorded.
    """

    source: str
    record: Record
    step: float
    moving: np.ndarray
    signed: np.ndarray
    bandwidth: np.ndarray
    averaging: Averaging | None
    periods: np.ndarray
    reference: Record | None

    @property
    def periodic(self) -> bool:
        """Whether the record is one whole period, so that it continues over its ends."""
        return self.averaging is not None


def signals_of(model: Model, samples: Samples, rows: np.ndarray) -> dict[str, np.ndarray]:
    """What a record holds besides time and motion, on the given rows; absent where not logged.

    `coordinates` are the joints and, last and where it is logged beside them, the slew joint.
    """
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
    slew = [signals["slew_position"]] if "slew_position" in signals else []
    signals["coordinates"] = np.column_stack([signals["position"], *slew])
    return signals


def resolution_of(log: Log) -> np.ndarray:
    """Encoder resolution (coordinates,) of the readings as they were logged."""
    signals = [log.position] if log.slew_position is None else [log.position, log.slew_position]
    return np.concatenate(
        [
            encoder_resolution(signal.value.reshape(len(signal.time), -1))
            if signal.resolution is None
            else signal.resolution
            for signal in signals
        ]
    )


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
    motion: SmoothedMotion,
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


def where_moving(
    model: Model,
    motion: SmoothedMotion,
    step: float,
    periodic: bool,
    options: Options,
    settling: float = SETTLING,
) -> np.ndarray:
    """(n, j): where the sign of the velocity is known, or everywhere if nothing is masked.

    Friction of a motor that several joints turn needs the sign of its speed, on the rows of each.
    """
    if not options.mask_reversals:
        return np.ones((len(motion.position), len(model.joints)), dtype=bool)
    known = moving(motion, step, periodic, settling)[:, : len(model.joints)]
    for term in model.terms:
        if turned_by := term.turned_by(model.setting):
            at, shares = [model.joints.index(joint) for joint in turned_by], [*turned_by.values()]
            motor = replace(
                motion,
                velocity=motion.velocity[:, at] @ np.array(shares)[:, np.newaxis],
                velocity_noise=np.array([np.linalg.norm(motion.velocity_noise[at] * shares)]),
                bandwidth=motion.bandwidth[at].min(keepdims=True),
            )
            known[:, at] &= moving(motor, step, periodic, settling)
    return known
