"""Magnitudes of injected effects that give the relative magnitude asked for on a motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_sim.effects.form import Form, InjectedForm, Scale
from crane_sim.effects.loads import HASTY_SLEWING, SLEWS, UNEVEN_SLEWING
from crane_sim.effects.sensing import faults
from crane_sim.ground_truth import Clean, Spec, check_joints, clean
from crane_sim.parts.parameters import SimulatedCrane
from crane_sim.plant.closed_loop import Course, record
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Build, Sensors
from crane_trajectory.control.controller import Gains
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import Reference, plan
from crane_trajectory.motion.periodic import load_trajectory

# Slewing while the booms are excited: what it does to them is no part of a planar model.

SLEW = 0  # the first joint: all others move with it
OVERTONES = {HASTY_SLEWING: 3, UNEVEN_SLEWING: 2}  # of the swings of a law, beside themselves


@dataclass(frozen=True)
class Slewing:
    """A motion during which the slew swings to and fro: its speed, and rad of phase a second.

    The `share` of it is an `overtone` of the swings.
    """

    motion: Course
    speed: float  # rad/s, largest
    frequency: float  # rad/s
    share: float = 0.0
    overtone: int = 1

    @property
    def start(self) -> np.ndarray:
        """(j,) as that of the motion [rad, m]."""
        return self.motion.start

    @property
    def duration(self) -> float:
        """As that of the motion [s]."""
        return self.motion.duration

    def reference(self, time: np.ndarray) -> Reference:
        """That of the motion, with the slew; whole swings, so that it ends where it began."""
        planar = self.motion.reference(time)
        time = np.clip(np.atleast_1d(time), 0.0, self.duration)
        swings = max(round(self.frequency * self.duration / (2.0 * np.pi)), 1)
        omega = 2.0 * np.pi * swings / self.duration
        speed = self.speed * np.array([1.0 - self.share, self.share])
        rate = omega * np.array([1.0, self.overtone])
        phase = np.multiply.outer(time, rate)
        angle = (1.0 - np.cos(phase)) @ (speed / rate)
        return Reference(
            _with_slew(planar.position, angle),
            _with_slew(planar.velocity, np.sin(phase) @ speed),
            _with_slew(planar.acceleration, np.cos(phase) @ (speed * rate)),
            planar.phase,
        )

    def probe(self, time: np.ndarray) -> np.ndarray:
        return self.motion.probe(time)


def _with_slew(values: np.ndarray, slewed: np.ndarray) -> np.ndarray:
    values = values.copy()
    values[:, SLEW] += slewed
    return values


def slewing(motion: Course, effects: Sequence[InjectedForm]) -> Course:
    """The motion, with the slew if one of the effects is that of slewing."""
    for effect in effects:
        law = effect.form.law
        if isinstance(law, int) and law in SLEWS:
            speed, frequency = effect.values[:2]
            share = sum(effect.values[2:])  # of laws that have one
            return Slewing(motion, speed, frequency, share, OVERTONES.get(law, 1))
    return motion


# Their magnitudes, found by moving the machine with them.

MAX_TRIES = 12
RELATIVE_MAGNITUDE_TOLERANCE = 0.05  # of the wanted relative magnitude
DEFAULT_TRAJECTORY = "excitation_20s.yaml"  # on which a spec is calibrated that names no trajectory
MAX_FACTOR = 8.0  # by which a magnitude changes at once
FLAT_SHARE = 0.01  # of a relative magnitude, by which it does not fall with its magnitude,
FLAT_TRIES = 3  # so often in turn: a smaller one would not help either


class UnmovedError(RangeError):
    """The relative magnitude of an injected effect on a motion does not follow its magnitude."""


def calibrate(
    spec: Spec, machine: Machine, simulated: SimulatedCrane, motion: Course, gains: Gains
) -> tuple[InjectedForm, ...]:
    """The effects of a spec with all their parameters, for a machine on a motion.

    If an effect has a relative magnitude, its magnitude is changed until its part in the force
    comes within 5 % of it, for all effects at once.

    Parameters
    ----------
    spec
        Effects to inject.
    machine, simulated
        Geometry and parameters of the simulated crane.
    motion
        Motion on which the relative magnitudes hold.
    gains
        Of the controller (36) that leads the crane.

    Returns
    -------
    The effects, in the order of the spec.

    Raises
    ------
    RangeError
        If a magnitude would be beyond what is plausible, or the force does not follow it.
    """
    build: Build = partial(Plant, simulated, machine)
    return reach(draw(spec, machine, simulated), machine, simulated, motion, gains, build)


def reach(
    effects: tuple[InjectedForm, ...],
    machine: Machine,
    simulated: SimulatedCrane,
    motion: Course,
    gains: Gains,
    build: Build,
) -> tuple[InjectedForm, ...]:
    """Effects with requested magnitudes in the machine of `build`; see `calibrate`."""
    open_ended = [k for k, effect in enumerate(effects) if effect.requested is not None]
    exponent = dict.fromkeys(open_ended, 1.0)  # relative magnitude as a power of the magnitude
    last: dict[int, tuple[float, float]] = {}
    flat = dict.fromkeys(open_ended, 0)
    for _ in range(MAX_TRIES if open_ended else 0):
        moved_with = moved(effects, machine, simulated, motion, gains, build)
        reached = moved_with.relative_magnitude(effects, machine)
        ratio = {k: (effects[k].requested or 0.0) / max(reached[k], 1e-12) for k in open_ended}
        if all(abs(np.log(r)) < RELATIVE_MAGNITUDE_TOLERANCE for r in ratio.values()):
            return effects
        for k, wanted in ratio.items():
            magnitude = effects[k].values[0]
            if k in last and reached[k] == 0.0 == last[k][1]:
                raise UnmovedError(_unseen(effects[k]))
            smaller = k in last and abs(magnitude) < abs(last[k][0])
            same = smaller and reached[k] >= (1.0 - FLAT_SHARE) * last[k][1]
            flat[k] = flat[k] + 1 if same else 0
            if flat[k] == FLAT_TRIES:
                raise UnmovedError(_no_less(effects[k], reached[k]))
            if k in last and last[k][0] != magnitude and reached[k] > 0.0 < last[k][1]:
                slope = np.log(reached[k] / last[k][1]) / np.log(magnitude / last[k][0])
                exponent[k] = float(np.clip(slope, 0.3, 3.0))
            last[k] = magnitude, reached[k]
            factor = wanted ** (1.0 / exponent[k])
            factor = float(np.clip(factor, 1.0 / MAX_FACTOR, MAX_FACTOR))
            effects = _scaled(effects, k, factor, reached[k], machine, simulated)
    if not open_ended:
        return effects
    names = ", ".join(
        f"'{effects[k].form.effect}' at {reached[k]:.3g} instead of {effects[k].requested}"
        for k in open_ended
    )
    raise RangeError(
        f"injected effects did not come within {RELATIVE_MAGNITUDE_TOLERANCE:.0%} of their "
        f"relative magnitudes in {MAX_TRIES} tries: {names}; ask for others or another motion"
    )


def injected_in(
    spec: Spec,
    machine: Machine,
    simulated: SimulatedCrane,
    gains: Gains,
    folder: Path | str | None = None,
) -> tuple[InjectedForm, ...]:
    """The effects of `spec` on the motion of its own: one machine, whatever is recorded of it.

    `folder` is that of the machine, or its name, as `machine_file` takes it.
    """
    if all(effect.relative_magnitude is None for effect in spec.effects):
        return draw(spec, machine, simulated)
    trajectory = load_trajectory(spec.trajectory or machine_file(DEFAULT_TRAJECTORY, folder))
    clearance = load_clearance(machine_file("clearance.yaml", folder))
    motion = plan(machine, trajectory, simulated.start, 1, clearance)
    return calibrate(spec, machine, simulated, motion, gains)


def draw(spec: Spec, machine: Machine, simulated: SimulatedCrane) -> tuple[InjectedForm, ...]:
    """The effects with the parameters that are given or drawn, each magnitude at its start."""
    check_joints(spec, machine, "injected effects")
    effects = []
    for index, effect in enumerate(spec.effects):
        drawn = draw_one(
            np.random.default_rng([spec.seed, index]),
            simulated,
            InjectedForm(effect.law, effect.joint, (), effect.relative_magnitude),
            effect.parameters,
        )
        effects.append(drawn)
    return tuple(effects)


def draw_one(
    rng: np.random.Generator,
    simulated: SimulatedCrane,
    wanted: InjectedForm,
    given: Mapping[str, float],
) -> InjectedForm:
    """The effect with the `given` parameters, and others drawn; its magnitude is at its start."""
    form, joint = wanted.form, wanted.joint
    drawn = {
        entry.name: entry.between(rng) * _scale(entry.of, simulated, joint) for entry in form.draws
    }
    start = form.magnitude.start * _scale(form.magnitude.of, simulated, joint)
    if form.signed:
        start *= rng.choice([-1.0, 1.0])
    values = {form.magnitude.name: start} | drawn | dict(given)
    return wanted._replace(values=tuple(values.values()))


def moved(
    effects: Sequence[InjectedForm],
    machine: Machine,
    simulated: SimulatedCrane,
    motion: Course,
    gains: Gains,
    build: Build | None = None,
) -> Clean:
    """Record the motion with these effects, on the machine of `build` (default: `Plant`)."""
    plant = (build or partial(Plant, simulated, machine))(motion.start, effects, 0.0)
    sensors = Sensors(simulated.sensors, machine, 0, faults(effects, machine))
    recording = record(slewing(motion, effects), plant, sensors, gains)
    return clean(machine, effects, sensors.faults, recording.truth, plant.machine)


def _scale(of: Scale, simulated: SimulatedCrane, joint: str | None) -> float:
    return 1.0 if joint is None else of(simulated, joint)


def _scaled(
    effects: tuple[InjectedForm, ...],
    k: int,
    factor: float,
    reached: float,
    machine: Machine,
    simulated: SimulatedCrane,
) -> tuple[InjectedForm, ...]:
    """With the magnitude of effect k times `factor`; `RangeError` if that is too much."""
    effect = effects[k]
    value, form = effect.values[0] * factor, effect.form
    highest = form.magnitude.highest * _scale(form.magnitude.of, simulated, effect.joint)
    if abs(value) > highest and abs(effect.values[0]) >= highest:
        raise RangeError(_beyond(form, effect, machine, highest, reached))
    values = (float(np.clip(value, -highest, highest)), *effect.values[1:])
    return (*effects[:k], effect._replace(values=values), *effects[k + 1 :])


def _unseen(effect: InjectedForm) -> str:
    return (
        f"injected effect '{effect.form.effect}' ({effect.form.name}) on "
        f"{effect.joint or 'the machine'} does nothing on this motion; take one that shows it, as "
        "into the ends of the range for cushions"
    )


def _no_less(effect: InjectedForm, reached: float) -> str:
    return (
        f"injected effect '{effect.form.effect}' ({effect.form.name}) on "
        f"{effect.joint or 'the machine'} has a relative magnitude of {reached:.4f} on this "
        f"motion, however small its {effect.form.magnitude.name}; {effect.requested} was asked "
        "for. Ask for more, or take another of its laws"
    )


def _beyond(
    form: Form, effect: InjectedForm, machine: Machine, highest: float, reached: float
) -> str:
    unit = form.unit(form.magnitude.unit, machine, effect.joint)
    return (
        f"injected effect '{form.effect}' ({form.name}) on {effect.joint or 'the machine'} has a "
        f"relative magnitude of {reached:.4f} on this motion with {form.magnitude.name} = "
        f"{highest:.6g} {unit}, the most that is plausible; {effect.requested} was asked for. "
        "Ask for less, or take a motion that shows it"
    )
