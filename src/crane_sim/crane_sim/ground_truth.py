"""The effects to inject, as a user writes them, and the ground truth of a recording with them."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from crane_model.configuration import Schema, load, validate
from crane_model.cylinders import generalized_forces, lever_arms
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.result_file import Number, ResultFile, ResultPart
from crane_sim.effects.form import Form, InjectedForm, SensorFault, measured_joints
from crane_sim.effects.kernel import FORMS
from crane_sim.parts.parameters import SimulatedCrane
from crane_sim.plant.closed_loop import States, TrueStates


class InjectedEffect(Schema):
    """One effect: of a given relative magnitude, or with its magnitude among the `parameters`.

    `relative_magnitude` is the share of the drive force, rms over rms, that the effect is to have;
    parameters that are not given are drawn. `form` is the first of the effect by default.
    """

    effect: str
    joint: str | None = None
    form: str | None = None
    relative_magnitude: Annotated[float, Field(gt=0, le=0.5)] | None = None
    parameters: dict[str, float] = {}

    @model_validator(mode="after")
    def _known(self) -> Self:
        forms = FORMS.get(self.effect)
        if forms is None:
            raise ValueError(f"no effect '{self.effect}'; there are {', '.join(sorted(FORMS))}")
        names = [form.name for form in forms]
        if self.form is not None and self.form not in names:
            raise ValueError(f"'{self.effect}' has no form '{self.form}', but {', '.join(names)}")
        form = self.law
        if form.where.whole and self.joint is not None:
            raise ValueError(f"'{self.effect}' acts on the whole machine: give no joint")
        known = [form.magnitude.name, *(draw.name for draw in form.draws)]
        if unknown := sorted(self.parameters.keys() - set(known)):
            raise ValueError(
                f"'{self.effect}' has the parameters {', '.join(known)}, not {', '.join(unknown)}"
            )
        if (self.relative_magnitude is None) != (form.magnitude.name in self.parameters):
            raise ValueError(
                f"'{self.effect}': give either its relative_magnitude or its parameter {known[0]}"
            )
        return self

    @property
    def law(self) -> Form:
        """The form that is meant."""
        forms = FORMS[self.effect]
        return next((form for form in forms if form.name == self.form), forms[0])


class Spec(Schema):
    """Effects to inject into a machine; `seed` is that of the parameters which are drawn.

    Relative magnitudes are those on one period of `trajectory`, by default the packaged excitation.
    """

    seed: int = 0
    trajectory: Path | None = None
    effects: tuple[InjectedEffect, ...] = ()


def load_spec(path: Path | str) -> Spec:
    """Read a spec of effects to inject; its trajectory lies beside it.

    Parameters
    ----------
    path
        YAML file.

    Raises
    ------
    ConfigurationError
        If the file is wrong.
    """
    spec = load(path, Spec)
    if spec.trajectory is None:
        return spec
    return spec.model_copy(update={"trajectory": Path(path).parent / spec.trajectory})


def check_joints(spec: Spec, machine: Machine, source: Path | str) -> Spec:
    """The spec; `ConfigurationError` where an effect cannot act on its joint of the machine."""
    for effect in spec.effects:
        where = effect.law.where
        joints = where.joints(machine)
        if where.fits(machine) and (where.whole or effect.joint in joints):
            continue
        there = f"a joint of {', '.join(joints)}; got {effect.joint!r}" if joints else "no such"
        raise ConfigurationError(
            f"{source}: '{effect.effect}' acts on {where.value}"
            f"{'' if where.whole else ', whose pressures are measured'}: "
            f"of {machine.name}, {there}"
        )
    return spec


SLIDING_SHARE = 0.02  # of the fastest that a joint moves, above which it slides

# True course of a recording: states, forces and the part of each injected effect in them.


@dataclass(frozen=True)
class Clean(States):
    """n samples without noise and quantisation, k effects."""

    drive: np.ndarray  # (n, j) generalized forces of the cylinders (27), N m, N
    seen_position: np.ndarray  # (n, j) with the faults of the sensors
    seen_drive: np.ndarray  # (n, j) generalized forces from pressures and positions as seen
    force: np.ndarray  # (k, n, j) part of each effect in `seen_drive`
    flow: np.ndarray  # (k, n, j) part of each effect in the flow into chamber A, m3/s
    relative_magnitude_by_joint: np.ndarray  # (k, j) rms of part over rms of whole, while it slides

    def relative_magnitude(self, effects: Sequence[InjectedForm], machine: Machine) -> np.ndarray:
        """(k,) on the joint of each effect; of the whole machine where it is strongest."""
        measured = [machine.index(joint) for joint in measured_joints(machine)]
        return np.array(
            [
                row[measured].max() if effect.joint is None else row[machine.index(effect.joint)]
                for effect, row in zip(effects, self.relative_magnitude_by_joint, strict=True)
            ]
        )

    def save(self, path: Path | str) -> None:
        """As arrays of an npz file, each under its name."""
        np.savez_compressed(path, **asdict(self))


def clean(
    machine: Machine,
    effects: Sequence[InjectedForm],
    faults: Sequence[SensorFault],
    truth: TrueStates,
    actual: Machine | None = None,
) -> Clean:
    """The parts of the `effects`, of which `faults` are those of sensors, in a recording.

    A fault's part is what it changes in the force that is computed from the readings, by the
    geometry of `machine`; that of the machine itself is `actual`, by default the same.
    """
    joints = machine.joint_names
    q, p_a, p_b = truth.position, truth.pressure_a, truth.pressure_b
    drive = seen = generalized_forces(machine, q, p_a, p_b, joints)
    force = np.zeros((len(effects), *drive.shape))
    flow = np.zeros_like(force)
    inside = [k for k, effect in enumerate(effects) if isinstance(effect.form.law, int)]
    force[inside] = truth.injected_force
    if actual is not None and actual is not machine:
        force[inside] *= lever_arms(machine, q, joints) / lever_arms(actual, q, joints)
    flow[inside] = truth.injected_flow
    outside = [k for k in range(len(effects)) if k not in inside]
    for k, fault in zip(outside, faults, strict=True):
        q = fault.positions(q)
        p_a, p_b = fault.pressures(truth.time, p_a, p_b)
        before, seen = seen, generalized_forces(machine, q, p_a, p_b, joints)
        force[k] = seen - before
    areas = np.array([machine.cylinders[joint].area_a for joint in joints])
    swept = areas * lever_arms(machine, truth.position, joints) * truth.velocity
    speed = np.abs(truth.velocity)
    sliding = speed > SLIDING_SHARE * speed.max(axis=0)
    return Clean(
        time=truth.time,
        position=truth.position,
        velocity=truth.velocity,
        acceleration=truth.acceleration,
        pressure_a=truth.pressure_a,
        pressure_b=truth.pressure_b,
        drive=drive,
        seen_position=q,
        seen_drive=seen,
        force=force,
        flow=flow,
        relative_magnitude_by_joint=_share(force, drive, sliding) + _share(flow, swept, sliding),
    )


def _share(part: np.ndarray, whole: np.ndarray, sliding: np.ndarray) -> np.ndarray:
    """(k, j): rms of (k, n, j) over rms of (n, j) in `sliding` samples (n, j); 0 if nil."""
    rms = np.sqrt((sliding * whole**2).sum(axis=0))
    return np.sqrt((sliding * part**2).sum(axis=1)) / np.where(rms > 0.0, rms, np.inf)


# The ground truth of a bag, kept away from the bag.

OUTSIDE_CATALOGUE = "outside"  # in the place of the id of an effect that no catalogue has


class TrueParameter(ResultPart):
    """A parameter of an injected effect."""

    name: str
    """As in a spec."""
    value: float
    """Value of the machine [unit]."""
    unit: str
    """SI; `1` for a ratio."""


class TrueEffect(ResultPart):
    """An injected effect."""

    effect: str
    """Its type in the catalogue of `diagnose`, or `outside`."""
    name: str
    """Its name in a spec."""
    joint: str | None
    """The joint; null: the whole machine."""
    form: str
    """The law that it follows in the simulated crane."""
    parameters: list[TrueParameter]
    """Parameters of that model form."""
    relative_magnitude_requested: Number
    """Rms of its force over that of the drive, asked for while its joint slides [-]; null: none."""
    relative_magnitude: float
    """The same as reached [-]."""
    relative_magnitude_by_joint: dict[str, float]
    """As reached on each joint [-]."""


class GroundTruth(ResultFile):
    """Effects that were injected into a bag (`make_bag --ground-truth`)."""

    bag: str
    """Name of its folder."""
    seed: int
    """Seed of its noise [-]."""
    clean: str
    """File beside the ground truth with the forces of the effects, without noise."""
    machine: str
    """Digest of the machine that made it."""
    effects: list[TrueEffect]
    """All of them."""


def ground_truth(
    effects: Sequence[InjectedForm], clean: Clean, machine: Machine
) -> list[TrueEffect]:
    """One entry an effect: form, parameters, requested and reached magnitude."""
    entries = []
    reached = clean.relative_magnitude(effects, machine)
    for k, effect in enumerate(effects):
        form = effect.form
        described = [(form.magnitude.name, form.magnitude.unit)]
        described += [(entry.name, entry.unit) for entry in form.draws]
        entries.append(
            TrueEffect(
                effect=OUTSIDE_CATALOGUE if form.outside else form.effect,
                name=form.effect,
                joint=effect.joint,
                form=form.name,
                parameters=[
                    TrueParameter(
                        name=name, value=value, unit=form.unit(unit, machine, effect.joint)
                    )
                    for (name, unit), value in zip(described, effect.values, strict=True)
                ],
                relative_magnitude_requested=effect.requested,
                relative_magnitude=float(reached[k]),
                relative_magnitude_by_joint={
                    joint: float(clean.relative_magnitude_by_joint[k, machine.index(joint)])
                    for joint in measured_joints(machine)
                },
            )
        )
    return entries


def check_place(path: Path, bag: Path) -> None:
    """`ConfigurationError` for a file in the bag's folder, `DataError` for one that exists."""
    if path.resolve().is_relative_to(bag.resolve()):
        raise ConfigurationError(
            f"--ground-truth {path}: lies in the folder of the bag, {bag}, which must not reveal "
            "what was injected; name a file elsewhere"
        )
    if path.suffix != ".json":
        raise ConfigurationError(f"--ground-truth {path}: the suffix of a ground truth is .json")
    for file in (path, clean_path(path)):
        if file.exists():
            raise DataError(f"{file}: exists; name a file that does not exist yet")


def clean_path(path: Path) -> Path:
    """Path of the arrays of a ground truth."""
    return path.with_suffix(".npz")


def write_ground_truth(
    path: Path,
    bag: Path,
    seed: int,
    machine: Machine,
    simulated: SimulatedCrane,
    effects: Sequence[InjectedForm],
    clean: Clean,
) -> None:
    """The ground truth of a bag and, beside it, the arrays of `clean`."""
    check_place(path, bag)
    content = GroundTruth(
        bag=bag.name,
        seed=seed,
        clean=clean_path(path).name,
        machine=_digest(machine, simulated),
        effects=ground_truth(effects, clean, machine),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    content.write(path)
    clean.save(clean_path(path))


def load_injected(path: Path, machine: Machine, simulated: SimulatedCrane) -> Spec:
    """The effects of a spec, or of the ground truth of a bag of this machine.

    `ConfigurationError` if the file is wrong, or the ground truth that of another machine.
    """
    if path.suffix != ".json":
        return check_joints(load_spec(path), machine, path)
    try:
        content = GroundTruth.read(path)
    except DataError as error:
        raise ConfigurationError(
            f"{error}; give a ground truth that --ground-truth has written, or a spec (YAML)"
        ) from None
    effects = [
        {
            "effect": entry.name,
            "joint": entry.joint,
            "form": entry.form,
            "parameters": {parameter.name: parameter.value for parameter in entry.parameters},
        }
        for entry in content.effects
    ]
    if content.machine != _digest(machine, simulated):
        raise ConfigurationError(
            f"{path}: the ground truth of another machine than '{simulated.name}' with the geometry"
            f" of '{machine.name}'; give the files --plant and --machine that its bag was made with"
        )
    return check_joints(validate({"effects": effects}, Spec, path), machine, path)


def _digest(machine: Machine, simulated: SimulatedCrane) -> str:
    """Tells machines apart, whatever their names."""
    text = machine.model_dump_json() + simulated.model_dump_json()
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
