"""Checks of the forces: what a plausible machine can explain, masses, delay, and repairs."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy import signal
from scipy.ndimage import binary_erosion
from scipy.optimize import lsq_linear, minimize

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples, resample
from crane_identification.notation import spoken
from crane_identification.recording_check import limits
from crane_identification.recording_check.suspicion import Suspicion
from crane_model.cylinders import lever_arms
from crane_model.errors import DataError, RangeError
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.record import Record
from crane_model.terms.term import Setting

FORCE_FILTER_ORDER = 4
FORCE_FILTER_PADDING = 3 * FORCE_FILTER_ORDER
NEGLIGIBLE = 1e-9  # relative size of a direction that the data do not determine
RECORD_MOTION = ("position", "velocity", "acceleration")
CHAMBERS = ("pressure_a", "pressure_b")
TINY = float(np.finfo(float).tiny)
SHORTEST_RECORDING = 6.0 * limits.LONGEST_DELAY  # s, of which the ends are not used
DELAYS_S = np.arange(
    -limits.LONGEST_DELAY, limits.LONGEST_DELAY + limits.DELAY_STEP / 2, limits.DELAY_STEP
)  # s
DRIFTS = np.linspace(
    -limits.LARGEST_DRIFT, limits.LARGEST_DRIFT, 17
)  # s/s, a quarter of a per cent apart


@dataclass(frozen=True)
class Grid:
    """n samples of j joints every `step` s: the longest run of a recording without gaps.

    `record` holds motion, and pressures and command where logged, all with one smooth low-pass;
    `force` (n, j) is the generalized force where that, not pressures, was logged. Supply and tank
    are those of the machine where they were not logged.
    """

    machine: Machine
    record: Record
    force: np.ndarray | None
    step: float

    @property
    def joints(self) -> tuple[str, ...]:
        return self.record.joints

    @cached_property
    def moving(self) -> np.ndarray:
        """(n, j) where friction has one sign, and has settled."""
        moves = (
            np.abs(self.record.velocity)
            > limits.MOVING * self.machine.ranges(self.joints).slower_speed
        )
        around = max(1, round(limits.FORCE_SETTLING_S / self.step))
        return np.stack([binary_erosion(column, iterations=around) for column in moves.T], axis=1)

    @cached_property
    def arms(self) -> np.ndarray:
        """(n, j) lever arms; `RangeError` where a linkage cannot be assembled."""
        return lever_arms(self.machine, self.record.position, self.joints)

    @cached_property
    def pistons(self) -> np.ndarray:
        """(n, j) cylinder forces (19), or generalized forces where those were logged."""
        if self.force is not None:
            return self.force
        record, cylinders = self.record, [self.machine.cylinders[joint] for joint in self.joints]
        area_a = np.array([cylinder.area_a for cylinder in cylinders])
        area_b = np.array([cylinder.area_b for cylinder in cylinders])
        return area_a * record.pressure_a - area_b * record.pressure_b

    def generalized(self, pistons: np.ndarray) -> np.ndarray:
        """(n, j) generalized forces (27) of `pistons`."""
        return pistons if self.force is not None else self.arms * pistons


class LongestRun:
    """The longest run of `samples` without a gap, behind a low-pass of `bandwidth` [Hz]."""

    def __init__(self, samples: Samples, bandwidth: float):
        """`DataError` if it is too short, or sampled too slowly."""
        rows = np.flatnonzero(samples.run == np.bincount(samples.run).argmax())
        if len(rows) <= FORCE_FILTER_PADDING or samples.rate <= 2.0 * bandwidth:
            raise DataError(f"{len(rows)} samples at {samples.rate:.3g} Hz are too few")
        self._every = max(1, int(samples.rate / limits.WORKING_RATE))
        self._sections = signal.butter(FORCE_FILTER_ORDER, bandwidth, fs=samples.rate, output="sos")
        self.rows, self.step = rows, self._every / samples.rate
        self.time = samples.time[rows][:: self._every]

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """(n, ...) at `time`, from values (N, ...) of all samples."""
        kept = values[self.rows]
        smoothed = signal.sosfiltfilt(self._sections, kept, axis=0, padlen=FORCE_FILTER_PADDING)
        return np.asarray(smoothed[:: self._every])


def grid(machine: Machine, log: Log, joints: tuple[str, ...]) -> Grid:
    """The joints `joints` of a log; `DataError` if they hardly move, or are not logged together."""
    samples = resample(log)
    run = LongestRun(samples, limits.BANDWIDTH)
    columns = [log.joints.index(joint) for joint in joints]

    def smooth(values: np.ndarray | None) -> np.ndarray | None:
        if values is None or not np.isfinite(values[run.rows]).all():
            return None
        return run.smooth(values if values.ndim == 1 else values[:, columns])

    def constant(values: np.ndarray | None, stated: float) -> np.ndarray:
        found = smooth(values)
        return np.full(len(run.time), stated) if found is None else found

    command = samples.command
    if command is not None and not np.isnan(command).all():
        command = np.nan_to_num(command)  # closed where none was logged yet
    position = smooth(samples.position)
    assert position is not None  # resample leaves no NaN
    velocity = np.gradient(position, run.step, axis=0)
    hydraulics = machine.hydraulics
    whole = Grid(
        machine,
        Record(
            joints=joints,
            time=run.time,
            position=position,
            velocity=velocity,
            acceleration=np.gradient(velocity, run.step, axis=0),
            pressure_a=smooth(samples.pressure_a),
            pressure_b=smooth(samples.pressure_b),
            command=smooth(command),
            supply_pressure=constant(samples.supply_pressure, hydraulics.supply_pressure),
            tank_pressure=constant(samples.tank_pressure, hydraulics.tank_pressure),
        ),
        smooth(samples.force),
        run.step,
    )
    seconds = dict(zip(joints, whole.moving.sum(axis=0) * run.step, strict=True))
    lazy = [
        f"{joint} {time:.1f} s" for joint, time in seconds.items() if time < limits.LEAST_MOTION
    ]
    if lazy:
        raise DataError(f"{limits.LEAST_MOTION:g} s of motion needed, got of {', '.join(lazy)}")
    return whole


# How much of the measured force a crane with plausible masses and friction can explain.


def crane(machine: Machine) -> Model:
    """The model (16) of the report on the joints of this machine; what is checked must not depend
    on terms that a user tries. `ConfigurationError` if it is no crane as of the report.
    """
    model = _standard()
    names = dict(zip(model.joints, machine.as_planar().joints, strict=True))
    units = {names[joint]: unit for joint, unit in model.setting.units.items()}
    terms = tuple(
        term.model_copy(update={"joint": names[term.only_joint]}) if term.only_joint else term
        for term in model.terms
    )
    return replace(model, setting=Setting(units, machine), terms=terms)


@cache
def _standard() -> Model:
    return load_model(machine_file("model.yaml"))


@dataclass(frozen=True)
class Equations:
    """Rows (N,) of (28) where joints move, each joint's scaled by the rms of its force.

    `columns` (N, p) scaled to norm 1 by `norms` (p,); `force` (N,) by `scale` (j,) [N m, N]. The
    rows are those of the samples `sample` (N,) and the joints `joint` (N,).
    """

    columns: np.ndarray
    norms: np.ndarray
    force: np.ndarray
    scale: np.ndarray
    sample: np.ndarray
    joint: np.ndarray

    def explained(self, model: Model) -> float:
        """Share (rms) that is left of the force by plausible masses and friction that brakes."""
        assert model.machine is not None
        plausible = model.machine.plausible
        low, high = np.array(
            [
                plausible.get(
                    parameter.name,
                    (-np.inf if parameter.minimum is None else parameter.minimum, np.inf),
                )
                for parameter in model.parameters
            ]
        ).T
        q, r = np.linalg.qr(self.columns)
        bounds = (low * self.norms, high * self.norms)
        found = lsq_linear(r, q.T @ self.force, bounds=bounds).x
        return float(np.sqrt(np.mean((self.force - self.columns @ found) ** 2)))

    def free(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Any masses and friction (p,), their standard deviations (p,), and the share left."""
        inverse = np.linalg.pinv(self.columns, rcond=NEGLIGIBLE)
        found = inverse @ self.force
        left = float(np.mean((self.force - self.columns @ found) ** 2))
        spread = np.sqrt(limits.CORRELATED * left * (inverse**2).sum(axis=1))
        return found / self.norms, spread / self.norms, float(np.sqrt(left))


def equations(model: Model, whole: Grid, inside: slice = slice(None)) -> Equations:
    """Equations of the samples `inside`; `RangeError` if the linkages cannot be assembled."""
    used = np.zeros_like(whole.moving)
    used[inside] = whole.moving[inside]
    force = whole.generalized(whole.pistons)
    scale = np.sqrt((force**2 * used).sum(axis=0) / np.maximum(used.sum(axis=0), 1))
    scale[scale == 0.0] = 1.0
    columns = (model.regressor(whole.record) / scale[:, np.newaxis])[used]
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0.0] = 1.0
    return Equations(columns / norms, norms, (force / scale)[used], scale, *np.nonzero(used))


# Static balance: the masses that the force needs, against the plausible ones of the machine.


def masses(model: Model, values: np.ndarray, std_devs: np.ndarray) -> Iterator[Suspicion]:
    """Find implausible `values` (p,), given their standard deviations (p,)."""
    assert model.machine is not None
    plausible = model.machine.plausible
    wrong, ratios = [], []
    for parameter, value, spread in zip(model.parameters, values, std_devs, strict=True):
        if parameter.name not in plausible or spread > limits.KNOWN_MASS_SIGMA * abs(value):
            continue
        low, high = plausible[parameter.name]
        ratios.append(value / np.sqrt(low * high))
        if not low <= value <= high:
            wrong.append(
                f"{parameter.name} {value:.4g} {parameter.unit}, plausible {low:g} to {high:g}"
            )
    if not wrong:
        return
    known = np.array(ratios)
    factor = float(np.median(known))
    where, evidence = "masses that the force carries", ", ".join(wrong)
    if (known < 0.0).all():
        cause = "the load would lift the crane: the sign of the forces is reversed"
        yield Suspicion(where, evidence, cause, decisive=True)
    elif len(known) > 1 and (np.abs(known / factor - 1.0) < limits.SAME_FACTOR_TOLERANCE).all():
        cause = (
            f"all are about {factor:.2g} times what is plausible: unit of force or pressure, "
            "piston areas, or the plausible masses of the machine file"
        )
        yield Suspicion(where, evidence, cause, decisive=True)
    else:
        cause = "a load that the machine file does not know, a wrong transducer, or wrong geometry"
        yield Suspicion(where, evidence, cause)


# Mix-ups of wiring and names, and the recording as it would be without each.


@dataclass(frozen=True)
class Repair:
    """Change of a recording: `where` and `what`; `joint` is the one with exchanged chambers."""

    where: str
    what: str
    repaired: Grid
    joint: str | None = None


def repairs(whole: Grid) -> Iterator[Repair]:
    """Every single mix-up undone."""
    measured = ("force",) if whole.force is not None else CHAMBERS
    for j, joint in enumerate(whole.joints):
        signs = np.where(np.arange(len(whole.joints)) == j, -1.0, 1.0)
        turned = _changed(whole, RECORD_MOTION, lambda values, s=signs: s * values)
        yield Repair(spoken(joint), "the sign of its position is reversed", turned)
        if whole.force is None:
            yield Repair(
                spoken(joint), "chambers A and B are exchanged", _chambers(whole, j), joint
            )
        else:
            turned = _changed(whole, measured, lambda values, s=signs: s * values)
            yield Repair(spoken(joint), "the sign of its force is reversed", turned)
    for i, k in combinations(range(len(whole.joints)), 2):
        order = np.arange(len(whole.joints))
        order[[i, k]] = k, i
        where = f"{spoken(whole.joints[i])} and {spoken(whole.joints[k])}"
        for names, signals in (
            ("positions", RECORD_MOTION),
            ("forces" if whole.force is not None else "pressures", measured),
            ("names", (*RECORD_MOTION, *measured)),
        ):
            exchanged = _changed(whole, signals, lambda values, o=order: values[:, o])
            yield Repair(where, f"their {names} are exchanged", exchanged)


def unexplained(model: Model, repair: Repair) -> float:
    """Share of the force that is left; infinite where the linkages cannot be assembled so."""
    try:
        return equations(model, repair.repaired).explained(model)
    except RangeError:
        return np.inf


def _changed(whole: Grid, names: tuple[str, ...], by: Callable[..., np.ndarray]) -> Grid:
    of_record: dict[str, Any] = {n: by(getattr(whole.record, n)) for n in names if n != "force"}
    force = by(whole.force) if "force" in names else whole.force
    return Grid(whole.machine, replace(whole.record, **of_record), force, whole.step)


def _chambers(whole: Grid, j: int) -> Grid:
    a, b = whole.record.needed("pressure_a", "check"), whole.record.needed("pressure_b", "check")
    first, second = a.copy(), b.copy()
    first[:, j], second[:, j] = b[:, j], a[:, j]
    return Grid(
        whole.machine,
        replace(whole.record, pressure_a=first, pressure_b=second),
        whole.force,
        whole.step,
    )


# Delay and drift between forces and positions, where the force fits the motion best.


@dataclass(frozen=True)
class Delay:
    """The force is `delay` [s] behind the positions in the middle, and gains `drift` [s/s].

    `left` and `left_without` are the shares of the force unexplained as recorded, and without the
    delay. `joints` are those on which it shows; it is `common` where they are several that agree.
    """

    delay: float
    drift: float
    left: float
    left_without: float
    joints: tuple[str, ...]
    common: bool


class _Scan:
    """Unexplained force at each delay of the force against the motion."""

    def __init__(self, model: Model, whole: Grid) -> None:
        margin = round(limits.LONGEST_DELAY / whole.step) + 1
        every = max(1, int(whole.moving.sum()) // limits.ROWS)
        found = equations(model, whole, slice(margin, len(whole.record) - margin, every))
        self.whole, self.rows, self.joint = whole, found.sample, found.joint
        self.basis = np.linalg.qr(found.columns)[0]
        self.scale = 1.0 / found.scale[found.joint]
        self.time = whole.record.time - whole.record.time[0]
        self.middle = 0.5 * self.time[-1]

    def left(self, delay: float, drift: float) -> np.ndarray:
        """(j,) power unexplained of each joint, over that of its force."""
        at = self.time + delay + drift * (self.time - self.middle)
        shifted = np.stack(
            [np.interp(at, self.time, piston) for piston in self.whole.pistons.T], axis=1
        )
        force = self.whole.generalized(shifted)[self.rows, self.joint] * self.scale
        error = force - self.basis @ (self.basis.T @ force)
        count = len(self.whole.joints)
        left, power = (
            np.bincount(self.joint, values**2, minlength=count) for values in (error, force)
        )
        return left / np.maximum(power, TINY)


def find_delay(model: Model, whole: Grid) -> Delay | None:
    """The delay that explains most of what is unexplained, or None where none matters."""
    if whole.record.time[-1] - whole.record.time[0] < SHORTEST_RECORDING:
        return None
    scan, joints = _Scan(model, whole), range(len(whole.joints))
    as_is = scan.left(0.0, 0.0)
    if np.sqrt(as_is.max()) < limits.LEAST_UNEXPLAINED:
        return None
    at_steps = np.array([scan.left(step, 0.0) for step in DELAYS_S])  # (steps, j)
    delay, drift = _best(scan, at_steps.sum(axis=1))
    of_joints = [_of_joint(scan, j, DELAYS_S[at_steps[:, j].argmin()], drift) for j in joints]
    shows = [
        j
        for j in joints
        if (drift or abs(of_joints[j].delay) > limits.SHORTEST_DELAY)
        and np.sqrt(as_is[j]) > limits.LEAST_UNEXPLAINED
        and of_joints[j].left < limits.POWER_LEFT * as_is[j]
    ]
    if not shows:
        return None
    delays = np.array([of_joints[j].delay for j in shows])
    typical = float(np.median(delays))
    alike = np.abs(delays - typical) < max(limits.SHORTEST_DELAY, limits.AGREEING * abs(typical))
    common = len(shows) > 1 and bool(alike.all())
    if not common:
        worst = max(shows, key=lambda j: as_is[j] - of_joints[j].left)
        if of_joints[worst].left > limits.ALONE * as_is[worst]:
            return None
        shows, delay = [worst], of_joints[worst].delay
    without = scan.left(delay, drift)
    left, left_without = (float(np.sqrt(power[shows].mean())) for power in (as_is, without))
    return Delay(delay, drift, left, left_without, tuple(whole.joints[j] for j in shows), common)


class _OfJoint(NamedTuple):
    """The best delay [s] of one joint, and the power that it leaves."""

    delay: float
    left: float


def _of_joint(scan: _Scan, j: int, around: float, drift: float) -> _OfJoint:
    delays = around + np.linspace(-limits.DELAY_STEP, limits.DELAY_STEP, 21)
    left = np.array([scan.left(delay, drift)[j] for delay in delays])
    return _OfJoint(float(delays[left.argmin()]), float(left.min()))


def _best(scan: _Scan, at_steps: np.ndarray) -> tuple[float, float]:
    """Delay and drift that leave least, given what each of `DELAYS_S` leaves (steps,).

    A drift must leave much less than any delay, and must be one that clocks have.
    """
    delay, drift = float(DELAYS_S[at_steps.argmin()]), 0.0
    drifting = [(d, s) for s in DRIFTS for d in delay + limits.DELAY_STEP * np.arange(-8, 9, 2)]
    tried = [scan.left(*pair).sum() for pair in drifting]
    if min(tried) < limits.POWER_LEFT * at_steps.min():
        delay, drift = _refined(scan, *drifting[int(np.argmin(tried))])
    if abs(drift) < max(limits.DRIFT, limits.LEAST_DRIFT / scan.time[-1]):
        drift = 0.0
    return (delay, drift) if drift else _refined(scan, delay, 0.0)


def _refined(scan: _Scan, delay: float, drift: float) -> tuple[float, float]:
    """The best delay and drift around these; without drift there is none."""
    scale = np.array([limits.DELAY_STEP, limits.DRIFT])
    free = np.array([1.0, float(drift != 0.0)])
    start = np.array([delay, drift])

    def left(x: np.ndarray) -> float:
        return float(scan.left(*(start + free * scale * x)).sum())

    found = minimize(left, np.zeros(2), method="Nelder-Mead", options={"maxfev": 60}).x
    best = start + free * scale * found
    return float(best[0]), float(best[1])
