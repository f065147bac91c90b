"""The hydraulics of a machine from recordings of its motion, joint by joint."""

from collections.abc import Mapping, Sequence
from statistics import fmean

from crane_identification.data.log import Log
from crane_identification.hydraulics.balance import CUT_OFF
from crane_identification.hydraulics.joint_estimate import (
    ASSUMED_MODULUS,
    JointFit,
    identify_joint,
)
from crane_identification.hydraulics.motion_estimate import identify_motion
from crane_identification.hydraulics.supply import identify_supply
from crane_model.errors import DataError, RangeError
from crane_model.hydraulics.values import HydraulicValues
from crane_model.model_file import Model
from crane_model.progress import Progress, silent


def identify_hydraulics(
    model: Model, logs: Sequence[Log], period: float | None = None, progress: Progress = silent
) -> HydraulicValues | None:
    """What recordings tell of valves, oil and supply; None if no command shows anything of them.

    Joints of which nothing can be told are named with the reason.
    """
    machine = model.machine
    wanted = [log for log in logs if log.command is not None]
    if machine is None or not wanted:
        return None
    unknown: dict[str, str] = {}
    found: dict[str, JointFit] = {}
    sensed = {joint for joint, one in machine.cylinders.items() if one.pressure_sensors}
    fitted = sorted(  # those last that take the oil of the others for their own
        (joint for joint in model.joints if joint in sensed),
        key=lambda joint: not machine.cylinders[joint].chambers.grow,
    )
    blind = [joint for joint in machine.cylinders if joint not in sensed]
    for number, joint in enumerate(fitted):
        try:
            found[joint] = identify_joint(machine, joint, wanted, period, _oil_of(found))
        except (DataError, RangeError) as error:
            unknown[joint] = str(error)
        progress("hydraulics", (number + 1) / len(fitted))
    supply = None
    if found and len(found) == len(fitted):
        try:
            supply = identify_supply(tuple(found.values()), wanted)
        except DataError as error:
            unknown["supply"] = str(error)
    joints = {joint: found[joint].values for joint in model.joints if joint in found}
    for joint in blind:
        try:
            joints[joint] = identify_motion(machine, joint, wanted)
        except (DataError, RangeError) as error:
            unknown[joint] = str(error)
    if not joints and not any(log.pressure_a is not None for log in wanted):
        return None
    rows = sum(len(one.balance.flow) for one in found.values())
    sources = ", ".join(dict.fromkeys(log.source for log in wanted))
    return HydraulicValues(
        provenance=f"balance of flow below {CUT_OFF:g} Hz, both chambers, {rows} rows of {sources}",
        joints=joints,
        supply=supply,
        unknown=unknown,
    )


def _oil_of(found: Mapping[str, JointFit]) -> float:
    """Mean bulk modulus [Pa] of the joints that tell it."""
    chambers = [one.values.chambers for one in found.values()]
    told = [one.bulk_modulus.value for one in chambers if one and one.bulk_modulus.std_dev]
    return fmean(told) if told else ASSUMED_MODULUS
