"""Machines of both simulators, and the model forms of effects that they can inject."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_benchmark.cases.case import Case, EffectToHide, Simulator
from crane_benchmark.cases.motions import PLANAR, PLANAR_JOINTS
from crane_benchmark.independent.readings import FAMILIES
from crane_model.machine import Machine
from crane_model.record import Record
from crane_sim.calibration import SLEW, draw_one
from crane_sim.effects.form import Form, InjectedForm, SensorFault
from crane_sim.effects.kernel import FORMS
from crane_sim.effects.sensing import drawn_flaws
from crane_sim.ground_truth import Clean
from crane_sim.parts.parameters import (
    SimulatedCrane,
    load_simulated_crane,
    vary,
    vary_geometry,
    vary_hydraulics,
    vary_sensors,
    vary_valves,
)
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Build

# Drawn machines of the primary simulator: other parameters.

SPREAD = 0.3  # of masses, friction and leakage
OF_VALVES = 0.15  # of spools, rated flows, hoses and supply line
OF_SENSORS = 0.3  # of noise and jitter
USUAL_MODULUS = (1.15e9, 1.7e9)  # Pa, of oil as it is usual
PLANT_STEPS_S = (1e-4, 2e-4)  # s, of the plant
SURVEYED = 0.002  # of the lengths of a machine whose file was measured on it: at most
AS_DRAWN = 0.03  # of one whose file is taken from drawings
LAWS: Mapping[Simulator, Mapping[str, Sequence[Form]]] = {
    Simulator.PRIMARY: FORMS,
    Simulator.INDEPENDENT: FAMILIES,
}
"""Model forms that the machines of each simulator have, by effect."""
KEPT_EVERY = 4  # of the samples of a bag, that are kept
SPEED = 2e-3  # rad/s, m/s, below which a joint counts as at rest: dry friction may be any force
# Share of its encoder that a joint must have moved since it turned: one there, one here
LEAST_ENCODER_COUNTS = 2


def drawn_home(
    simulated: SimulatedCrane, machine: Machine, seed: int, spools: bool
) -> tuple[SimulatedCrane, Build]:
    """A machine about `simulated` and what makes it, in the geometry of `machine`.

    The valves have unequal edges where its `spools` are said to be so. The same seed gives the same
    one.
    """
    rng = np.random.default_rng([seed, 5])  # not the draws of `vary`
    drawn = vary_sensors(vary(simulated, seed, SPREAD), seed, OF_SENSORS)
    drawn = vary_hydraulics(drawn, seed, OF_VALVES)
    oil = drawn.oil.model_copy(update={"bulk_modulus": float(rng.uniform(*USUAL_MODULUS))})
    drawn = drawn.model_copy(update={"oil": oil, "step": float(rng.choice(PLANT_STEPS_S))})
    if spools:
        drawn = vary_valves(drawn, machine, seed)
    return drawn, partial(Plant, drawn, machine)


class DrawnMachine(NamedTuple):
    """The machine of a case."""

    simulated: SimulatedCrane  # its parameters
    actual: Machine  # its geometry; that of the machine file is what a diagnosis is given
    build: Build  # what makes it
    flaws: tuple[SensorFault, ...]  # of its sensors


def drawn_machine(case: Case, machine: Machine, seed: int) -> DrawnMachine:
    """That of a case, about the one in the file `machine`."""
    actual = vary_geometry(machine, seed, AS_DRAWN if case.off else SURVEYED)
    flaws = drawn_flaws(machine, seed)
    if case.simulator is Simulator.INDEPENDENT:
        # only here: MuJoCo is an extra, which the primary simulator does not need
        from crane_benchmark.independent.plant import drawn_independent

        simulated, build = drawn_independent(load_simulated_crane(), actual, seed)
    else:
        simulated, build = drawn_home(load_simulated_crane(), actual, seed, case.spools)
    return DrawnMachine(simulated, actual, build, flaws)


def drawn_effects(
    simulator: Simulator, effects: Sequence[EffectToHide], simulated: SimulatedCrane, seed: int
) -> tuple[InjectedForm, ...]:
    """The effects with drawn parameters, each magnitude at its start."""
    injected = []
    for index, wanted_effect in enumerate(effects):
        form = next(
            form
            for form in LAWS[simulator][wanted_effect.effect]
            if form.name == wanted_effect.form
        )
        wanted = InjectedForm(form, wanted_effect.joint, (), wanted_effect.relative_magnitude)
        rng = np.random.default_rng([seed, index])
        injected.append(draw_one(rng, simulated, wanted, {}))
    return tuple(injected)


# A recording without noise: the scorer's own measure of the injected effects.


def save_clean(path: Path, clean: Clean) -> None:
    """Every fourth sample of what the scorer needs."""

    def planar(values: np.ndarray) -> np.ndarray:
        return values[..., ::KEPT_EVERY, :][..., PLANAR]

    slew = (clean.position, clean.velocity, clean.acceleration)
    np.savez_compressed(
        path,
        time=clean.time[::KEPT_EVERY],
        position=planar(clean.seen_position),
        velocity=planar(clean.velocity),
        acceleration=planar(clean.acceleration),
        pressure_a=planar(clean.pressure_a),
        pressure_b=planar(clean.pressure_b),
        force=planar(clean.seen_drive),
        hidden=planar(clean.force),
        way=planar(_way(clean.seen_position, clean.velocity)),
        slew=np.stack([values[::KEPT_EVERY, SLEW] for values in slew]),
    )


@dataclass(frozen=True)
class Seen:
    """Recordings of a case without noise: n samples of j joints.

    `hidden` (k, n, j): the part of each effect in the force; `used` (n, j): where a joint moves
    and encoders tell which way.
    """

    record: Record
    hidden: np.ndarray
    used: np.ndarray

    def rms(self, values: np.ndarray) -> np.ndarray:
        """Root mean square (j,) of values (n, j) over the used samples."""
        power = (np.where(self.used, values, 0.0) ** 2).sum(axis=0)
        return np.sqrt(power / np.maximum(self.used.sum(axis=0), 1))


def load_seen(paths: Sequence[Path], effects: Sequence[Sequence[int]], count: int) -> Seen:
    """The recordings in `paths`; the rows of `hidden` in each are those of `effects` of `count`."""
    parts: dict[str, list[np.ndarray]] = {}
    hidden, runs = [], []
    for number, (path, of_recording) in enumerate(zip(paths, effects, strict=True)):
        with np.load(path) as file:
            for name in file.files:
                parts.setdefault(name, []).append(file[name])
            whole = np.zeros((count, *file["force"].shape))
            whole[list(of_recording)] = file["hidden"]
        hidden.append(whole)
        runs.append(np.full(len(parts["time"][-1]), number))
    slew = np.concatenate(parts["slew"], axis=1)

    def joined(name: str) -> np.ndarray:
        return np.concatenate(parts[name])

    record = Record(
        joints=PLANAR_JOINTS,
        time=joined("time"),
        position=joined("position"),
        velocity=joined("velocity"),
        acceleration=joined("acceleration"),
        run=np.concatenate(runs),
        force=joined("force"),
        pressure_a=joined("pressure_a"),
        pressure_b=joined("pressure_b"),
        slew_position=slew[0],
        slew_velocity=slew[1],
        slew_acceleration=slew[2],
    )
    steps = load_simulated_crane().sensors.encoder_resolution
    seen = joined("way") > LEAST_ENCODER_COUNTS * np.array(
        [steps[joint] for joint in PLANAR_JOINTS]
    )
    used = seen & (np.abs(record.velocity) > SPEED)
    return Seen(record, np.concatenate(hidden, axis=1), used)


def _way(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(n, j) how far each joint has moved since it last turned, or since the recording began.

    Of all samples of a recording: where friction is carried by bristles, a joint that comes to rest
    trembles at some 30 Hz, which every fourth of them would hide.
    """
    ways = np.sign(velocity)
    turned = np.ones(ways.shape, dtype=bool)
    turned[1:] = ways[1:] != ways[:-1]
    number = np.arange(len(ways))[:, np.newaxis]
    last = np.maximum.accumulate(np.where(turned, number, 0), axis=0)
    return np.abs(position - np.take_along_axis(position, last, axis=0))
