"""What is estimated, and how far it is trusted."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.model_file import Model

# What the filter is given and what it tells, a window of time at once; j joints.


class FlowWindow(NamedTuple):
    """What was measured in it."""

    time: float  # s, at its end
    duration: float  # s
    sums: Array  # (j, SUMS) of `crane_observer.position.flow`
    before: Array  # (2, j) Pa in chambers A and B as it began
    after: Array  # (2, j) Pa as it ended
    encoders: Array  # (j,) rad or m at its end; NaN where there is none
    blind: Array  # (j,) s of it in which what flowed is not known
    whole: bool  # pressures were measured all the time


class PoseEstimate(NamedTuple):
    """What is known after it."""

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


DOUBTFUL = (
    0.01  # of friction, its standard deviation in a model that is trusted as little as can be
)
UNEXPLAINED = 0.01  # of a flow, rms, in a model whose flow deviates as `Trust` has it
FLOW_SHARES = (0.02, 4.0)  # of these deviations, at least and at most
UNEVEN = 0.15  # of what an offset of a transducer does to flow, that gains do not take up
LEAST = 0.058  # of the deviations of such a model, those of one without any lack of fit
SHARPENED = 1.5  # power of the doubt in friction with which what a fit leaves unexplained grows
NOISE_ALONE = 0.01  # probability, from which on what is unexplained of a flow is noise of readings


@dataclass(frozen=True)
class StateLayout:
    """Where the states of j joints stand: of each joint eight, the load at the tip, and two more.

    Coordinates [rad, m]; errors of the flow gain where the cylinder extends and where it retracts
    [1]; null of the valve [of the stroke]; error of the piston's force, as one of pressure in
    chamber A [Pa]; error of dry and of viscous friction [of what the model has]; friction by which
    a joint is held while it stands [of dry friction]; load [kg]; and, not estimated but considered,
    by how much the transducers of chambers A and B are off [of what they are trusted].
    """

    joints: int

    @property
    def size(self) -> int:
        """How many states there are."""
        return KINDS * self.joints + 1

    def of(self, kind: int) -> slice:
        """The states of one kind, by joint: POSITION, EXTENDING, ..., OFFSET_B."""
        begin = kind * self.joints + (kind >= ESTIMATED)
        return slice(begin, begin + self.joints)

    @property
    def load(self) -> int:
        """The place of the load."""
        return ESTIMATED * self.joints

    @property
    def told(self) -> NDArray[np.int64]:
        """(j + 1,) the places of coordinates and load."""
        return np.append(np.arange(self.joints), self.load)


POSITION, EXTENDING, RETRACTING, NULL, PRESSURE, DRY, VISCOUS, HELD, OFFSET_A, OFFSET_B = range(10)
KINDS, ESTIMATED = 10, 8


@dataclass(frozen=True)
class Trust:
    """How far an identified model is trusted: standard deviations, and for how long errors stay.

    What `identify` says of its values is what noise did to them; these say how far a machine is
    from any model, and from itself on another day.
    """

    gain: float = 0.005  # of the flow, each direction
    null: float = 0.001  # of the stroke, beside the standard deviations of dead zones and play
    stays: float = 600.0  # s, of gains and nulls
    pressure: float = 0.3e5  # Pa, of the piston's force
    pressure_stays: float = 20.0  # s
    dry: float = 0.1  # of dry friction
    viscous: float = 0.05  # of viscous friction
    friction_stays: float = 60.0  # s
    held: float = 1.0  # of dry friction, that holds a joint which stands
    load: float = 60.0  # kg, of a load that has just come or gone
    load_drift: float = 0.05  # kg/sqrt(s)
    stroke: float = 0.005  # of the stroke of a window, beside gains
    noise: float = 0.5e5  # Pa, of a window's force balance, beside what stays
    inertia: float = 0.05  # of the force that accelerates
    reading: float = 1.2e4  # Pa, noise of one reading of a pressure
    transducer: float = 0.2e5  # Pa, off at a metering edge, of which gains take up a part

    @classmethod
    def of(cls, model: Model) -> "Trust":
        """As far as the model deserves it: standard deviations of friction tell how far (13) is
        from the machine, since they hold what the law does not explain.
        """
        doubts = [0.0]
        for term, part in zip(model.terms, map(model.part, model.terms), strict=True):
            if not term.is_friction() or model.std_devs is None:
                continue
            for k, parameter in enumerate(term.parameters(model.setting), start=part.start):
                if parameter.minimum == 0.0 and model.theta[k] > 0.0:
                    doubts.append(float(model.std_devs[k] / model.theta[k]) / DOUBTFUL)
        return cls().times(min(max(LEAST, max(doubts) ** SHARPENED), 1.0))

    def times(self, share: float) -> "Trust":
        """With a share of each deviation that a model is to blame for."""
        blamed = ("pressure", "dry", "viscous", "noise", "inertia", "transducer")
        return replace(self, **{name: share * getattr(self, name) for name in blamed})

    def spread(self, layout: StateLayout) -> Array:
        """(size,) standard deviations that states have where nothing is known; 0 of positions and
        of the load, which come with what is known of the start.
        """
        found = np.zeros(layout.size)
        found[layout.of(EXTENDING)] = found[layout.of(RETRACTING)] = self.gain
        found[layout.of(NULL)] = self.null
        found[layout.of(PRESSURE)] = self.pressure
        found[layout.of(DRY)] = self.dry
        found[layout.of(VISCOUS)] = self.viscous
        found[layout.of(HELD)] = self.held
        found[layout.of(OFFSET_A)] = found[layout.of(OFFSET_B)] = 1.0
        return found

    def stay(self, layout: StateLayout) -> Array:
        """(size,) s that an error stays, of those that come and go; infinite of the others."""
        found = np.full(layout.size, np.inf)
        found[layout.of(EXTENDING)] = found[layout.of(RETRACTING)] = self.stays
        found[layout.of(NULL)] = self.stays
        found[layout.of(OFFSET_A)] = found[layout.of(OFFSET_B)] = self.stays
        found[layout.of(PRESSURE)] = self.pressure_stays
        found[layout.of(DRY)] = found[layout.of(VISCOUS)] = self.friction_stays
        return found


def flow_share(model: Model) -> Array:
    """(j,) share of the deviations of flow: as much as identification left unexplained, where that
    is more than noise.
    """
    assert model.hydraulics is not None  # or the error that names the remedy
    joints = [model.hydraulics.joints[joint] for joint in model.joints]
    noise = [one.lack_of_fit is not None and one.lack_of_fit > NOISE_ALONE for one in joints]
    left = np.array([one.unexplained for one in joints])
    return np.clip(np.where(noise, 0.0, left / UNEXPLAINED), *FLOW_SHARES)


def null_deviation(model: Model, least: Array) -> Array:
    """(j,) of the stroke: by which either null may be off, as identification has dead zones and
    play, and `least` (j,) beside it.
    """
    assert model.hydraulics is not None  # or the error that names the remedy
    valves = [model.hydraulics.joints[joint].valve for joint in model.joints]
    found = np.array(
        [
            [one.std_dev or 0.0 for one in (valve.dead_zone_a, valve.dead_zone_b, valve.hysteresis)]
            for valve in valves
        ]
    )
    dead_a, dead_b, play = found.T
    return np.sqrt(0.5 * (dead_a**2 + dead_b**2) + (0.5 * play) ** 2 + least**2)
