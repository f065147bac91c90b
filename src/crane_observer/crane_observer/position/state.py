"""State of the position estimator and the belief in it: an extended Kalman filter."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array, Flags
from crane_model.chain.dynamics import gravity_forces, tip_bodies
from crane_model.machine import Machine
from crane_model.model_file import Model

FRICTION_DOUBT_OF_POOR_MODEL = 0.01  # standard deviation over value
UNEXPLAINED_OF_TRUST = 0.01  # of a flow, rms, in a model whose flow deviates as `Trust` has it
FLOW_SHARES = (0.02, 4.0)  # of these deviations, at least and at most
GAIN_LEFTOVER = 0.15  # of what an offset of a transducer does to flow, that gains do not take up
LEAST_TRUST_SHARE = 0.058  # of the deviations, of a model without any lack of fit
DOUBT_POWER = 1.5  # of the doubt in friction with which what a fit leaves unexplained grows
NOISE_PROBABILITY = 0.01  # from which on what is unexplained of a flow is noise of readings
NUDGE = 1e-4  # rad, rad/s, m or m/s, for slopes
STANDING = 0.02  # of the fastest that a joint may move, below which it counts as standing
UNKNOWN_LOAD = 100.0  # kg, standard deviation of a load of which nothing is known
UNKNOWN_SHARE = 0.77  # of the load that the drives hold, where one is known: the same
POSES_PER_JOINT = 5  # in which it is seen what they hold
HOLDS_LITTLE = 1.0  # N m/kg, N/kg: a joint that 1 kg loads by less does not hold it
MISSING_SHARE = 0.1  # of an unknown load, that the tip may lack of what the model has there
HEAVIEST_SHARE = 2.0  # of an unknown load, what may hang at the tip


class FlowWindow(NamedTuple):
    """Measurements of j joints in a window of time."""

    time: float  # s, at its end
    duration: float  # s
    sums: np.ndarray  # (j,) records FLOW_SUMS of `crane_observer.position.flow`
    before: Array  # (2, j) Pa in chambers A and B as it began
    after: Array  # (2, j) Pa as it ended
    encoders: Array  # (j,) rad or m at its end; NaN where there is none
    blind: Array  # (j,) s of it in which the flow is not known
    whole: bool  # pressures were measured all the time

    def followed_by(self, later: "FlowWindow") -> "FlowWindow":
        """Both as one window."""
        sums = self.sums.copy()
        for name in sums.dtype.names or ():
            sums[name] += later.sums[name]
        sums["moment"] += self.duration * later.sums["impulse"]
        return later._replace(
            duration=self.duration + later.duration,
            sums=sums,
            before=self.before,
            blind=self.blind + later.blind,
            whole=self.whole and later.whole,
        )


class Pair(NamedTuple):
    """Two windows, one after the other, the velocities in them (2, j), and their shortest pairs."""

    first: FlowWindow
    second: FlowWindow
    velocities: Array
    steps: int

    @classmethod
    def of(cls, gathered: Sequence[tuple[FlowWindow, Array]]) -> "Pair":
        """From windows with their velocities (j,), as many in the first as in the second."""
        steps = len(gathered) // 2
        halves = gathered[:steps], gathered[steps:]
        first, second = (
            reduce(FlowWindow.followed_by, (window for window, _ in half)) for half in halves
        )
        velocities = [
            np.average([v for _, v in half], axis=0, weights=[w.duration for w, _ in half])
            for half in halves
        ]
        return cls(first, second, np.stack(velocities), steps)

    @property
    def duration(self) -> float:
        """Duration of both [s]."""
        return self.first.duration + self.second.duration

    @property
    def velocity(self) -> Array:
        """(j,) mean."""
        of_both = np.array([[self.first.duration], [self.second.duration]])
        return np.asarray((of_both * self.velocities).sum(axis=0) / self.duration)

    @property
    def acceleration(self) -> Array:
        """(j,) between them."""
        return np.asarray((self.velocities[1] - self.velocities[0]) * 2.0 / self.duration)

    def without_motion(self, held: Flags) -> "Pair":
        """Velocities of joints that stand (j,) are noise, and would pass for a load's."""
        return self._replace(velocities=np.where(held, 0.0, self.velocities))

    @property
    def opened(self) -> Flags:
        """(j,) whose valve was open for some time."""
        both = np.abs(self.first.sums["null"]) + np.abs(self.second.sums["null"])
        return np.asarray((both > 0.0).any(axis=1))

    @property
    def force(self) -> Array:
        """(j,) forces of the pistons [N], averaged under a triangle as the acceleration is."""
        rising = self.first.sums["moment"] / self.first.duration
        second = self.second.sums
        falling = second["impulse"] - second["moment"] / self.second.duration
        return np.asarray((rising + falling) * 2.0 / self.duration)


class PoseEstimate(NamedTuple):
    """Pose of j joints after a window."""

    time: float  # s
    position: Array  # (j,)
    covariance: Array  # (j + 1, j + 1) of positions and load
    load: float  # kg
    velocity: Array  # (j,) mean over the window
    surprised: bool  # a load came or went in this window

    @property
    def deviation(self) -> Array:
        """(j + 1,) standard deviations of positions and load."""
        return np.sqrt(np.diag(self.covariance))


class StateLayout(NamedTuple):
    """Places of the states of j joints in a vector of `size`; slices are by joint.

    The last two kinds are not estimated but considered.
    """

    joints: int
    position: slice  # rad, m
    extending: slice  # error of the flow gain where the cylinder extends
    retracting: slice  # and where it retracts
    null: slice  # of the valve, of the stroke
    pressure: slice  # error of the piston's force, as of pressure in chamber A [Pa]
    dry: slice  # error of dry friction, of that of the model
    viscous: slice  # error of viscous friction, of that of the model
    held: slice  # friction that holds a joint which stands, of dry friction
    load: int  # at the tip [kg]
    offset_a: slice  # of the transducers of chambers A, of what they are trusted
    offset_b: slice  # the same of chambers B
    size: int

    @classmethod
    def of(cls, joints: int) -> "StateLayout":
        estimated = cls._fields[1 : cls._fields.index("load")]
        load = len(estimated) * joints
        begins = {name: kind * joints for kind, name in enumerate(estimated)}
        begins |= {"offset_a": load + 1, "offset_b": load + 1 + joints}
        kinds = {name: slice(begin, begin + joints) for name, begin in begins.items()}
        return cls(joints=joints, load=load, size=len(kinds) * joints + 1, **kinds)

    @property
    def told(self) -> NDArray[np.int64]:
        """(j + 1,) the places of coordinates and load."""
        return np.append(np.arange(self.joints), self.load)


@dataclass(frozen=True)
class Trust:
    """How far an identified model is trusted: standard deviations, and for how long errors stay.

    What `identify` says of its values is what noise did to them; these say how far a machine is
    from any model, and from itself on another day.
    """

    gain: float = 0.005  # of the flow, each direction
    null: float = 0.001  # of the stroke, beside the standard deviations of dead bands and play
    stays: float = 600.0  # s, of gains and nulls
    pressure: float = 0.3e5  # Pa, of the piston's force
    pressure_stays: float = 20.0  # s
    dry: float = 0.1  # of dry friction
    viscous: float = 0.05  # of viscous friction
    friction_stays: float = 60.0  # s
    held: float = 1.0  # of dry friction, that holds a joint which stands
    unknown: float = UNKNOWN_LOAD  # kg
    load: float = 0.6  # of an unknown load, of one that has just come or gone
    load_drift: float = 5e-4  # 1/sqrt(s), of an unknown load
    stroke: float = 0.005  # of the stroke of a window, beside gains
    noise: float = 0.5e5  # Pa, of a window's force balance, beside what stays
    inertia: float = 0.05  # of the force that accelerates
    reading: float = 1.2e4  # Pa, noise of one reading of a pressure
    transducer: float = 0.2e5  # Pa, off at a metering edge, of which gains take up a part

    @classmethod
    def of(cls, model: Model) -> "Trust":
        """Trust in the model: standard deviations of friction show how far (13) is off, and what
        the drives hold shows how heavy a load may be.
        """
        doubts = [0.0]
        for term, part in zip(model.terms, map(model.part, model.terms), strict=True):
            if not term.is_friction() or model.std_devs is None:
                continue
            for k, parameter in enumerate(term.parameters(model.setting), start=part.start):
                if parameter.minimum == 0.0 and model.theta[k] > 0.0:
                    doubt = float(model.std_devs[k] / model.theta[k])
                    doubts.append(doubt / FRICTION_DOUBT_OF_POOR_MODEL)
        share = min(max(LEAST_TRUST_SHARE, max(doubts) ** DOUBT_POWER), 1.0)
        return cls(unknown=unknown_load(model)).times(share)

    def times(self, share: float) -> "Trust":
        """With a share of each deviation that a model is to blame for."""
        blamed = ("pressure", "dry", "viscous", "noise", "inertia", "transducer")
        return replace(self, **{name: share * getattr(self, name) for name in blamed})

    def spread(self, layout: StateLayout) -> Array:
        """(size,) standard deviations of unknown states; 0 of positions and load."""
        found = np.zeros(layout.size)
        found[layout.extending] = found[layout.retracting] = self.gain
        found[layout.null] = self.null
        found[layout.pressure] = self.pressure
        found[layout.dry] = self.dry
        found[layout.viscous] = self.viscous
        found[layout.held] = self.held
        found[layout.offset_a] = found[layout.offset_b] = 1.0
        return found

    def stay(self, layout: StateLayout) -> Array:
        """(size,) s that an error stays, of those that come and go; infinite of the others."""
        found = np.full(layout.size, np.inf)
        found[layout.extending] = found[layout.retracting] = found[layout.null] = self.stays
        found[layout.offset_a] = found[layout.offset_b] = self.stays
        found[layout.pressure] = self.pressure_stays
        found[layout.dry] = found[layout.viscous] = self.friction_stays
        return found


def heaviest_load(machine: Machine, joints: Sequence[str]) -> float:
    """Load at the tip [kg] that the drives of `joints` hold in each pose at supply pressure.

    The machine's own weight does not count. Infinite if no joint with a cylinder carries the load.
    """
    limits = (machine.limits[joint] for joint in joints)
    ranges = [np.linspace(ends.position_min, ends.position_max, POSES_PER_JOINT) for ends in limits]
    poses = np.stack(np.meshgrid(*ranges), axis=-1).reshape(-1, len(joints))
    columns = [machine.index(joint) for joint in joints]
    whole = np.zeros((len(poses), len(machine.joint_names)))
    whole[:, columns] = poses
    weights = gravity_forces(machine.chain, tip_bodies(machine.chain)[0], whole)[:, columns]
    held = math.inf
    for weight, q, joint in zip(weights.T, poses.T, joints, strict=True):
        if (actuator := machine.cylinders.get(joint)) is None:
            continue
        lever = machine.cylinder(joint, q)[:, 1]
        area = np.where(lever * weight > 0.0, actuator.area_a, actuator.area_b)
        force = np.abs(lever) * area * machine.hydraulics.supply_pressure
        loaded = np.abs(weight) > HOLDS_LITTLE
        held = min(held, float((force[loaded] / np.abs(weight[loaded])).min(initial=np.inf)))
    return held


def unknown_load(model: Model) -> float:
    """Standard deviation of a load at the tip of which nothing is known [kg]."""
    heaviest = heaviest_load(model.machine, model.joints) if model.machine else math.inf
    return UNKNOWN_SHARE * heaviest if math.isfinite(heaviest) else UNKNOWN_LOAD


def flow_share(model: Model) -> Array:
    """(j,) share of the flow that identification left unexplained, if more than noise."""
    assert model.hydraulics is not None  # or the error that names the remedy
    joints = [model.hydraulics.joints[joint] for joint in model.joints]
    noise = [joint.lack_of_fit is not None and joint.lack_of_fit > NOISE_PROBABILITY
             for joint in joints]  # fmt: skip
    left = np.array([joint.unexplained for joint in joints])
    return np.clip(np.where(noise, 0.0, left / UNEXPLAINED_OF_TRUST), *FLOW_SHARES)


def null_deviation(model: Model, least: Array) -> Array:
    """(j,) possible error of either null, by dead bands and play, and `least` (j,) besides."""
    assert model.hydraulics is not None  # or the error that names the remedy
    valves = [model.hydraulics.joints[joint].valve for joint in model.joints]
    dead_a, dead_b, play = (
        np.array([getattr(valve, name).std_dev or 0.0 for valve in valves])
        for name in ("dead_band_a", "dead_band_b", "hysteresis")
    )
    return np.sqrt(0.5 * (dead_a**2 + dead_b**2) + (0.5 * play) ** 2 + least**2)


@njit(cache=True, error_model="numpy")
def relax(x: Array, P: Array, decay: Array, added: Array) -> None:
    """x' = decay x, P' = decay P decay + added, in place; decay and added (n,) on the diagonal."""
    n = len(x)
    for i in range(n):
        x[i] *= decay[i]
        for k in range(n):
            P[i, k] *= decay[i] * decay[k]
        P[i, i] += added[i]


@njit(cache=True, error_model="numpy")
def carry(P: Array, rows: NDArray[np.int64], slopes: Array) -> None:
    """P' = F P F^T in place; F is the identity but for independent `rows` (`slopes` (r, n))."""
    n = len(P)
    for r in range(len(rows)):
        i = rows[r]
        new = np.zeros(n)
        for k in range(n):
            if slopes[r, k] != 0.0:
                for m in range(n):
                    new[m] += slopes[r, k] * P[k, m]
        variance = 0.0
        for k in range(n):
            variance += slopes[r, k] * new[k]
        for m in range(n):
            P[i, m] = new[m]
            P[m, i] = new[m]
        P[i, i] = variance


@njit(cache=True, error_model="numpy")
def correct(
    x: Array, P: Array, H: Array, innovation: Array, variance: Array, estimated: int
) -> float:
    """Correct by measurements (r,) with slopes H (r, n), one after the other, in place.

    `innovation` is that before any of them; those of infinite variance say nothing. States from
    `estimated` on are considered and not estimated: their errors count, and nothing is learnt of
    them (Schmidt, Application of state-space methods to navigation problems, 1966). Returns the log
    likelihood.
    """
    n, likelihood = len(x), 0.0
    begun = x.copy()
    for r in range(len(innovation)):
        if not variance[r] < math.inf:
            continue
        seen = np.zeros(n)
        spread, left = variance[r], innovation[r]
        for i in range(n):
            for k in range(n):
                if H[r, k] != 0.0:
                    seen[i] += P[i, k] * H[r, k]
        for i in range(n):
            spread += H[r, i] * seen[i]
            left -= H[r, i] * (x[i] - begun[i])
        likelihood -= 0.5 * (left * left / spread + math.log(spread / variance[r]))
        for i in range(estimated):
            x[i] += seen[i] * left / spread
        for i in range(n):
            for k in range(n if i < estimated else estimated):
                P[i, k] -= seen[i] * seen[k] / spread
    return likelihood


class Gaussian:
    """Mean x (size,) and covariance P (size, size); `estimated` as in `correct`."""

    def __init__(self, x: Array, P: Array, estimated: int):
        self.x, self.P, self.estimated = x, P, estimated

    def copied(self) -> Self:
        copied = copy(self)
        copied.x, copied.P = self.x.copy(), self.P.copy()
        return copied

    def relax(self, decay: Array, added: Array) -> None:
        """x' = decay x + noise; `decay` and the variance `added` (size,) on the diagonal."""
        relax(self.x, self.P, decay, added)

    def move(self, displacement: Array, slopes: Array, noise: Array) -> None:
        """The first states, of a count r, go `way` (r,), whose slopes against all states before
        are such that their new ones have `slopes` (r, size); `noise` (r,) is its variance.
        """
        rows = np.arange(len(displacement))
        carry(self.P, rows, slopes)
        self.x[rows] += displacement
        self.P[rows, rows] += noise

    def correct(self, H: Array, innovation: Array, variance: Array) -> float:
        """By measurements (r,), as `correct` has them; returns the log likelihood."""
        return correct(self.x, self.P, H, innovation, variance, self.estimated)


class Prediction(NamedTuple):
    """From `before` to `after`: e' = F e + noise of errors e, whose covariance says how much."""

    before: Gaussian
    F: Array  # (size, size)
    after: Gaussian


class Correction(NamedTuple):
    """From `before` to `after`, by measurements (r,)."""

    before: Gaussian
    H: Array  # (r, size)
    variance: Array  # (r,)
    after: Gaussian


class KeptGaussian(Gaussian):
    """A belief that keeps its steps, the newest last."""

    def __init__(self, begun: Gaussian):
        super().__init__(begun.x.copy(), begun.P.copy(), begun.estimated)
        self.steps: list[Prediction | Correction] = []

    def relax(self, decay: Array, added: Array) -> None:
        before = self.now()
        super().relax(decay, added)
        self.steps.append(Prediction(before, np.diag(decay), self.now()))

    def move(self, displacement: Array, slopes: Array, noise: Array) -> None:
        before, F = self.now(), np.eye(len(self.x))
        super().move(displacement, slopes, noise)
        F[: len(displacement)] = slopes
        self.steps.append(Prediction(before, F, self.now()))

    def correct(self, H: Array, innovation: Array, variance: Array) -> float:
        before = self.now()
        likelihood = super().correct(H, innovation, variance)
        self.steps.append(Correction(before, H, variance, self.now()))
        return likelihood

    def now(self) -> Gaussian:
        return Gaussian(self.x.copy(), self.P.copy(), self.estimated)
