"""`observer`: what the observers are to reach, and what they reach, on machines at work."""

import io
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from crane_benchmark.measured import MeasuredRow, tell
from crane_benchmark.observing.machines import Observed, hard, stock
from crane_identification.identify import main as identify
from crane_model import cli
from crane_model.cli import between, whole
from crane_model.errors import CraneError
from crane_model.kinematics import tip_position
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_observer.position.estimator import ENCODER_DEVIATION, PositionEstimator
from crane_observer.position.filter import Filter
from crane_observer.position.replay import EstimatedCourse, replay, replay_smoothed, transition
from crane_observer.position.state import KeptGaussian, Trust
from crane_observer.recording import HeardRecording
from crane_sim.make_bag import make
from crane_sim.plant.closed_loop import SimulatedRecording
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import plan
from crane_trajectory.motion.periodic import load_trajectory

# Check of the standard deviations of a recording whose errors stay from window to window.
#
# A filter that is right makes errors e with covariance P, so that the normalised error squared
# (NEES) e^T P^-1 e of d errors has mean d at each moment (Bar-Shalom, Li and Kirubarajan,
# Estimation with Applications to Tracking and Navigation, 2001, 5.4). They test it over independent
# runs: the errors of one run are not independent, and its mean in time scatters far more. How much
# follows from the same filter. It also says how errors go on, e' = S e + noise, so that normalised
# errors at moments k and m, z = L^-1 e with P = L L^T, have the covariance
#
#     R_km = L_k^-1 S_k ... S_(m+1) P_m L_m^-T.
#
# The mean in time of |z|^2 over n moments is then a weighted sum of squares, whose weights are the
# eigenvalues of R: it has mean d and, over d, as much variance as chi-square with f = (n d)^2 /
# |R|^2 degrees of freedom (Satterthwaite 1946), between 1 and n d.

SURE = 0.95
COUNTED_EVERY = 10  # windows, of which one counts: errors stay for longer
NO_FORCE = 1e12  # Pa, noise of a force balance that is not to count
OFF = 0.3  # rad or m
CONVERGED = 60.0  # s of motion
MACHINES: dict[str, tuple[Callable[[], Observed], tuple[float, ...], float]] = {
    "stock": (stock, (2e-3, 2e-3, 5e-3), 0.01),
    "hard": (hard, (10e-3, 10e-3, 20e-3), 0.06),
}
"""How it is made; aims with one encoder missing [rad, rad, m], and of the tip with all [m]."""
PERIODS = 5  # of the excitation, for the identification
OBSERVER_COLUMNS = (
    "quantity", "target", "position estimator", "worst recording", "smoothed", "flow alone",
    "without load", "NEES", "its 95 % band", "recordings in their band", "in 95 % ellipsoid",
    "smoothed NEES",
)  # fmt: skip


class Consistency(NamedTuple):
    """Normalised errors squared over their dimension, in one recording or several."""

    nees: float  # mean; 1 where standard deviations are right
    freedom: float  # degrees of freedom of that mean

    @property
    def band(self) -> tuple[float, float]:
        """In which the mean of a filter that is right is in 95 of 100 recordings."""
        tails = [(1.0 - SURE) / 2.0, (1.0 + SURE) / 2.0]
        low, high = chi2.ppf(tails, self.freedom) / self.freedom
        return float(low), float(high)

    @property
    def holds(self) -> bool:
        low, high = self.band
        return low <= self.nees <= high


def of_recordings(found: Sequence[Consistency]) -> Consistency:
    """The mean of independent recordings, which scatters less: variances 2 / f add up."""
    nees = float(np.mean([recording.nees for recording in found]))
    return Consistency(nees, len(found) ** 2 / sum(1.0 / recording.freedom for recording in found))


class Freedom:
    """Degrees of freedom of the mean NEES of d of the n errors of a filter."""

    def __init__(self, places: np.ndarray):
        """`places` (d,) of these among the errors."""
        self._places = places
        self._on: np.ndarray | None = None  # (n, m d): P_m L_m^-T of all m, as they have gone on
        self._squares = 0.0  # |R|^2
        self._moments = 0

    def add(self, transition: np.ndarray, covariance: np.ndarray) -> None:
        """One more moment: S (n, n) since the last, and P (n, n)."""
        places = self._places
        root = np.linalg.cholesky(covariance[np.ix_(places, places)])
        now = np.linalg.solve(root, covariance[places]).T
        if self._on is None:
            self._on = now
        else:
            self._on = transition @ self._on
            alike = np.linalg.solve(root, self._on[places])
            self._squares += 2.0 * float((alike**2).sum())
            self._on = np.concatenate([self._on, now], axis=1)
        self._squares += len(places)
        self._moments += 1

    @property
    def value(self) -> float:
        """Between 1 and n d."""
        return (self._moments * len(self._places)) ** 2 / self._squares


class FreedomWatch:
    """That of a filter at work, from a time on."""

    def __init__(self, filter_: Filter, hidden: np.ndarray, since: float):
        """`hidden` (j,) joints count from `since` [s] on; the filter keeps its steps."""
        self._state = filter_.state = KeptGaussian(filter_.state)
        self._freedom, self._since = Freedom(np.flatnonzero(hidden)), since
        self._passed, self._windows = np.eye(len(filter_.state.x)), 0

    def __call__(self, time: float) -> None:
        """A window that ends at `time` [s] is done."""
        for step in self._state.steps:
            self._passed = transition(step) @ self._passed
        self._state.steps.clear()
        if time > self._since and self._windows % COUNTED_EVERY == 0:
            self._freedom.add(self._passed, self._state.P)
            self._passed = np.eye(len(self._passed))
        self._windows += 1

    @property
    def freedom(self) -> float:
        return self._freedom.value


# The position estimator on machines at work, beside flow alone and a filter that knows no load.


class Errors(NamedTuple):
    """RMS over a run."""

    joints: np.ndarray  # (j,) rad, m
    tip: float  # m
    nees: float  # normalised error squared of the joints without encoder, over their number
    inside: float  # share of the windows in which they are in their 95 % ellipsoid

    def shown(self, joint: int | None) -> float:
        """Errors of a joint [mrad, mm], or of the tip [cm]."""
        return 1e2 * self.tip if joint is None else 1e3 * float(self.joints[joint])


class Kind(NamedTuple):
    """An observer, by what it trusts."""

    name: str

    def trust(self, model: Model) -> Trust:
        full = Trust.of(model)
        if self is FLOW:
            return replace(full, noise=NO_FORCE)
        if self is NO_LOAD:
            return replace(full, load=0.0, load_drift=0.0)
        return full


FILTER, FLOW, NO_LOAD = Kind("position estimator"), Kind("flow alone"), Kind("without load")


def heard(made: SimulatedRecording, model: Model, observed: Observed) -> HeardRecording:
    """Readings of the sensors of the model's joints."""
    time = made.time - made.time[0]
    columns = [observed.machine.index(joint) for joint in model.joints]
    rows = [made.cylinders.index(joint) for joint in model.joints]
    pressures = made.pressures
    return HeardRecording(
        Path("made"), 0, time, made.position[:, columns], time, pressures.chamber_a[:, rows],
        pressures.chamber_b[:, rows], pressures.supply, time, made.command[:, columns],
    )  # fmt: skip


class ObservedRecording(NamedTuple):
    """A recording of a machine, and the model that was identified of it."""

    observed: Observed
    made: SimulatedRecording
    model: Model

    def observe(self, hidden: np.ndarray, kind: Kind, off: float = 0.0) -> Errors:
        """From a known start, or one that is `off` and trusted so far; errors count later."""
        recording = heard(self.made, self.model, self.observed)
        course = replay(self._sensor(recording, hidden, kind, off), recording, hidden)
        return self._errors(recording, course, hidden, off)

    def observe_and_smooth(
        self, hidden: np.ndarray, off: float = 0.0
    ) -> tuple[Errors, Errors, Consistency]:
        """The same by the position estimator, and with all that came later."""
        recording = heard(self.made, self.model, self.observed)
        sensor = self._sensor(recording, hidden, FILTER, off)
        (filter_,) = sensor.hypotheses.filters
        watch = FreedomWatch(filter_, hidden, _counted_from(off))
        course, smoothed = replay_smoothed(sensor, recording, hidden, watch)
        told = self._errors(recording, course, hidden, off)
        return (
            told,
            self._errors(recording, smoothed, hidden, off),
            Consistency(told.nees, watch.freedom),
        )

    def _sensor(
        self, recording: HeardRecording, hidden: np.ndarray, kind: Kind, off: float
    ) -> PositionEstimator:
        low, high, *_ = self.observed.machine.ranges(self.model.joints)
        start = np.clip(recording.encoders[0] + np.where(hidden, off, 0.0), low, high)
        return PositionEstimator(
            self.model, start, max(off, ENCODER_DEVIATION), kind.trust(self.model)
        )

    def _errors(
        self, recording: HeardRecording, course: EstimatedCourse, hidden: np.ndarray, off: float
    ) -> Errors:
        machine = self.observed.machine
        columns = [machine.index(joint) for joint in self.model.joints]
        truth = self.made.truth.position.T
        true = np.stack([np.interp(course.time, recording.encoder_time, q) for q in truth], axis=1)
        whole = true.copy()
        whole[:, columns] = course.position
        counted = course.time > _counted_from(off)
        error = (whole - true)[counted][:, columns]
        tip = np.linalg.norm(
            tip_position(machine, whole[counted]) - tip_position(machine, true[counted]), axis=1
        )
        places = np.flatnonzero(hidden)
        covariance = course.covariance[counted][:, places][:, :, places]
        away = error[:, places]
        squared = np.einsum("ni,nij,nj->n", away, np.linalg.inv(covariance), away)
        return Errors(
            np.sqrt((error**2).mean(axis=0)),
            float(np.sqrt((tip**2).mean())),
            float(squared.mean()) / len(places),
            float((squared < chi2.ppf(0.95, len(places))).mean()),
        )


def _counted_from(off: float) -> float:
    """s, from which on errors count."""
    return CONVERGED if off else 0.0


def identified(observed: Observed, seed: int, folder: Path) -> Model:
    """The model that `identify` makes of a bag of this machine; never its true values."""
    motion = plan(
        observed.machine,
        load_trajectory(machine_file("excitation_20s.yaml")),
        observed.simulated.start,
        PERIODS,
        load_clearance(machine_file("clearance.yaml")),
    )
    bag, out = folder / "train", folder / "model"
    make(bag, observed.machine, observed.simulated, motion, observed.gains, seed, observed.hidden)
    given = ["--model", str(machine_file("model.yaml")), "--train", str(bag), "--out", str(out)]
    if identify(given) != 0:
        raise CraneError(f"{bag}: the machine was not identified; the lines above say why")
    return load_model(out / "model.yaml")


class ObservedQuantity(NamedTuple):
    """Errors of one quantity in one recording."""

    what: str
    aim: float
    errors: tuple[float, ...]  # of the position estimator, smoothed, by flow alone, without load
    sensor: Errors
    smoothed: Errors
    consistency: Consistency


def measure(name: str, duration: float, seed: int) -> list[ObservedQuantity]:
    """On one machine, in one recording."""
    make_it, aims, tip_aim = MACHINES[name]
    observed = make_it()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        model = identified(observed, seed, Path(folder))
    made, _ = observed.at_work(duration, seed)
    watched, outcomes = ObservedRecording(observed, made, model), []

    def add(what: str, aim: float, hidden: np.ndarray, joint: int | None, off: float) -> None:
        sensor, smoothed, consistency = watched.observe_and_smooth(hidden, off)
        alternatives = [watched.observe(hidden, kind, off) for kind in (FLOW, NO_LOAD)]
        errors = tuple(estimate.shown(joint) for estimate in (sensor, smoothed, *alternatives))
        title = f"{name}: {what}"
        outcomes.append(ObservedQuantity(title, aim, errors, sensor, smoothed, consistency))

    for j, joint in enumerate(model.joints):
        unit = "mm" if model.setting.units[joint] == "m" else "mrad"
        what = f"{joint} without encoder [{unit}]"
        add(what, 1e3 * aims[j], np.arange(len(model.joints)) == j, j, 0.0)
    every = np.ones(len(model.joints), dtype=bool)
    for off, words in ((0.0, ""), (OFF, f", {OFF} off at the start, after a minute")):
        add(f"tip, no encoder{words} [cm]", 1e2 * tip_aim, every, None, off)
    return outcomes


def together(outcomes: Sequence[ObservedQuantity]) -> MeasuredRow:
    """One quantity in all recordings: root mean squares, and the worst of them."""
    errors = np.array([outcome.errors for outcome in outcomes])
    rms = np.sqrt((errors**2).mean(axis=0))
    values = dict(zip(("sensor", "smoothed", "flow", "no_load"), map(float, rms), strict=True))
    values["worst"] = float(errors[:, 0].max())
    every = of_recordings([outcome.consistency for outcome in outcomes])
    values["nees"], (values["low"], values["high"]) = every.nees, every.band
    values["inside"] = 100.0 * float(np.mean([outcome.sensor.inside for outcome in outcomes]))
    values["consistent"] = float(sum(outcome.consistency.holds for outcome in outcomes))
    values["smoothed_nees"] = float(np.mean([outcome.smoothed.nees for outcome in outcomes]))
    values |= {"recordings": float(len(outcomes)), "aim": outcomes[0].aim}
    shown = ("sensor", "worst", "smoothed", "flow", "no_load", "nees")
    return MeasuredRow(
        cells=[outcomes[0].what, f"{outcomes[0].aim:g}", *(f"{{{name}:.2f}}" for name in shown),
               "{low:.2f} to {high:.2f}", "{consistent:.0f} of {recordings:.0f}",
               "{inside:.0f} %", "{smoothed_nees:.2f}"],
        values=values,
    )  # fmt: skip


def missed(rows: Sequence[MeasuredRow]) -> list[str]:
    """Requirements that the position estimator misses, in words."""
    return [
        f"{row.cells[0]}: {row.values['sensor']:.2f}, aim {row.values['aim']:g}"
        for row in rows
        if row.values["sensor"] > row.values["aim"]
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the RMS errors of the position estimator on machines at work.

    The exit status is 1 if a target is missed.
    """
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument(
        "--seconds",
        type=between(10.0, 36000.0),
        default=600.0,
        help="duration of the work [s] (default: 600)",
    )
    parser.add_argument("--seed", type=whole(0), default=1, help="seed of the first recording")
    parser.add_argument(
        "--recordings",
        type=whole(1),
        default=5,
        help="number of recordings of each machine (default: 5)",
    )
    parser.add_argument("--out", type=Path, help="file for the results (JSON)")
    arguments = parser.parse_args(argv)

    def body() -> None:
        seeds = range(arguments.seed, arguments.seed + arguments.recordings)
        runs = [(name, arguments.seconds, seed) for name in MACHINES for seed in seeds]
        with ProcessPoolExecutor() as processes:
            found = list(processes.map(measure, *zip(*runs, strict=True)))
        by_what: dict[str, list[ObservedQuantity]] = {}
        for outcome in chain.from_iterable(found):
            by_what.setdefault(outcome.what, []).append(outcome)
        rows = [together(outcomes) for outcomes in by_what.values()]
        command = (
            f"ros2 run crane_benchmark observer --seconds {arguments.seconds:g} "
            f"--seed {arguments.seed} --recordings {arguments.recordings}"
        )
        tell(rows, OBSERVER_COLUMNS, command, arguments.out, missed(rows))

    return cli.run(body)
