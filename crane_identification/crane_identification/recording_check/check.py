"""The check of a recording against the machine, before any fit."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from crane_identification.data.log import Log
from crane_identification.recording_check.arm import ArmMotion, arm, signs
from crane_identification.recording_check.clocks import clocks, missing, positions, sampling
from crane_identification.recording_check.forces import grid
from crane_identification.recording_check.suspicion import Checked, Suspicion
from crane_identification.recording_check.transducers import pressures, transducers
from crane_identification.recording_check.wiring import wiring
from crane_model.errors import ConfigurationError, DataError, RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_observer.monitor.replay import watch


def faulty_sensors(model: Model, recordings: Sequence[Path], end: float) -> tuple[str, ...]:
    """Warnings of sensors that failed in bags before `end` [s], by an earlier `model`.

    Only a model with hydraulics, and bags with pressures and valve commands, tell enough.
    """
    if model.hydraulics is None:
        return ()
    warnings = []
    for bag in filter(Path.is_dir, recordings):
        try:
            seen = watch(bag, model, None)
        except DataError:  # without them there is nothing to compare
            continue
        warnings += [f"{bag}: {finding}" for finding in seen.findings if finding.onset < end]
    return tuple(warnings)


def check(machine: Machine | None, log: Log, model: Model | None = None) -> Checked:
    """Check a recording; report findings, and checks that were not possible.

    If the machine is not a forwarder crane, its forces are compared with the user's `model`.
    Sensors are checked first. Forces follow only if no sensor invalidates every result, because
    they would repeat the finding in other words. Faults that the fit reports better are not raised.
    """
    absent = list(missing(log))
    if any(suspicion.decisive for suspicion in absent):
        return _result(log, absent, "all other checks: too few data")
    found: list[Suspicion] = [*absent, *clocks(log), *transducers(log)]
    if machine is None:
        looked, reasons = _forces(log, None, model)
        reasons = ("limits, pressures: the model has no machine", *reasons)
        return _result(log, [*found, *looked], *reasons)
    found += sampling(log)
    if log.uncalibrated:
        reason = f"limits, pressures, forces: {', '.join(log.uncalibrated)} in counts"
        return _result(log, found, reason)
    found += [*positions(machine, log), *pressures(machine, log)]
    if any(suspicion.decisive for suspicion in found):
        return _result(log, found, "forces: the problems above would appear again")
    if machine.planar is None:
        looked, reasons = _forces(log, machine, model)
        return _result(log, [*found, *looked], *reasons)
    joints = machine.planar.joints
    if lacking := [joint for joint in joints if joint not in log.joints]:
        return _result(log, found, f"forces: the model lacks {', '.join(lacking)}")
    if log.force is None and (log.pressure_a is None or log.pressure_b is None):
        return _result(log, found, "forces: neither pressures nor forces were recorded")
    try:
        found += wiring(grid(machine, log, joints))
    except (DataError, RangeError) as error:
        return _result(log, found, f"forces: {error}")
    return _result(log, found)


def _forces(
    log: Log, machine: Machine | None, model: Model | None
) -> tuple[list[Suspicion], tuple[str, ...]]:
    """Findings in the forces of any machine, and the reason if none could be compared."""
    lacking = ("forces: no model of this machine is given (--model)",)
    if log.force is None and machine is None:
        return [], lacking
    try:
        moved = ArmMotion.of(log, machine)
        if model is None or model.joints != log.joints:
            return list(signs(moved)), lacking
        found = list(arm(model, moved))
        if not any(suspicion.decisive for suspicion in found):
            found += signs(moved)
        return found, ()
    except (DataError, RangeError, ConfigurationError) as error:
        return [], (f"forces: {error}",)


def vetted(
    machine: Machine | None, logs: Iterable[Log], trusted: bool, model: Model | None = None
) -> tuple[str, ...]:
    """Suspicions of recordings, as warnings; `DataError` with the decisive ones, unless `trusted`.

    The option that trusts a recording is --trust-recordings.
    """
    checked = [check(machine, log, model) for log in logs]
    refused = [
        f"{recording.source}: {wrong}" for recording in checked for wrong in recording.decisive
    ]
    if refused and not trusted:
        raise DataError(
            "\n".join(refused)
            + "\nRecord again or correct the column map or the machine file; if the "
            "recording is right, --trust-recordings goes on with it"
        )
    return tuple(
        f"{recording.source}: {wrong}" for recording in checked for wrong in recording.suspicions
    )


@contextmanager
def blaming(suspicions: Sequence[str]) -> Iterator[None]:
    """Add the suspicions to an error that a suspicious recording raises."""
    try:
        yield
    except DataError as error:
        if not suspicions:
            raise
        raise DataError("\n".join([f"{error}", "Suspicious before:", *suspicions])) from error


def _result(log: Log, found: Iterable[Suspicion], *unchecked: str) -> Checked:
    unstamped = (
        f"the clock of {topic}: its messages hold no usable stamp, and the times are those of the "
        "recorder"
        for topic in log.unstamped
    )
    return Checked(log.source, tuple(found), (*unstamped, *unchecked), log.notes)
