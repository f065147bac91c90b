"""What /diagnostics says of the trajectory node."""

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from crane_trajectory.experiment import Experiment


def condition(
    name: str,
    lifecycle: str,
    experiment: Experiment | None,
    last: str,
    driver: str,
    led: Mapping[str, str],
    stamp: Time,
) -> DiagnosticArray:
    """State, phase and tracking error; `last` is how the last experiment has ended.

    `led` is what the controller is led by and has learnt, in words.
    """
    found = DiagnosticStatus(name=f"{name}: experiment", level=DiagnosticStatus.OK)
    values = {"state": lifecycle, "driver": driver, "last result": last, "phase": "rest"}
    if experiment is None:
        found.message = f"{lifecycle}, no experiment runs"
        if lifecycle != "active":
            found.level = DiagnosticStatus.STALE
    else:
        phase = experiment.stage.name.lower()
        if experiment.target is not None:
            phase += f", {experiment.target.phase.name.lower()}"
        total = experiment.motion.duration
        found.message = f"{phase}, {experiment.elapsed:.1f} of {total:.1f} s"
        values["phase"] = phase
        values["controller"] = experiment.controlled
        units = experiment.motion.machine.units
        for (joint, unit), error in zip(units.items(), experiment.tracking_error, strict=True):
            values[f"tracking error, {joint} [{unit}]"] = f"{error:.4g}"
    values |= led
    found.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    message = DiagnosticArray(status=[found])
    message.header.stamp = stamp
    return message
