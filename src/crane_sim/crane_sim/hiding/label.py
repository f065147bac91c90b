"""The label: what a bag hides, kept away from the bag."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from crane_model.configuration import validate
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.result_file import Number, ResultFile, ResultPart
from crane_sim.effects.fault import measured_joints
from crane_sim.effects.form import Planted
from crane_sim.hiding.clean import Clean
from crane_sim.hiding.spec import Spec, check_joints, load_spec
from crane_sim.parts.parameters import StandIn

OUTSIDE = "outside"  # in the place of the id of an effect that no catalogue has


class LabelledParameter(ResultPart):
    """A parameter of a hidden effect."""

    name: str
    """As in a spec."""
    value: float
    """What the machine has [unit]."""
    unit: str
    """SI; `1` for a ratio."""


class LabelledEffect(ResultPart):
    """A hidden effect."""

    effect: str
    """Its type in the catalogue of `diagnose`, or `outside`."""
    name: str
    """Its name in a spec."""
    joint: str | None
    """The joint; null: the whole machine."""
    form: str
    """The law that it follows in the stand-in machine."""
    parameters: list[LabelledParameter]
    """Of that law."""
    strength_requested: Number
    """Rms of its force over that of the drive that was asked for [-]; null: none was."""
    strength: float
    """The same as reached [-]."""
    strength_by_joint: dict[str, float]
    """As reached on each joint [-]."""


class Label(ResultFile):
    """What a bag hides (`make_bag --label`)."""

    bag: str
    """Name of its folder."""
    seed: int
    """Of its noise [-]."""
    clean: str
    """File beside the label with the forces of the effects, without noise."""
    machine: str
    """Digest of the machine that made it."""
    effects: list[LabelledEffect]
    """All of them."""


def label(planted: Sequence[Planted], clean: Clean, machine: Machine) -> list[LabelledEffect]:
    """One entry an effect: what it is, its parameters, and the strength asked for and reached."""
    entries = []
    reached = clean.strength(planted, machine)
    for k, effect in enumerate(planted):
        form = effect.form
        described = [(form.magnitude.name, form.magnitude.unit)]
        described += [(entry.name, entry.unit) for entry in form.draws]
        entries.append(
            LabelledEffect(
                effect=OUTSIDE if form.outside else form.effect,
                name=form.effect,
                joint=effect.joint,
                form=form.name,
                parameters=[
                    LabelledParameter(
                        name=name, value=value, unit=form.unit(unit, machine, effect.joint)
                    )
                    for (name, unit), value in zip(described, effect.values, strict=True)
                ],
                strength_requested=effect.requested,
                strength=float(reached[k]),
                strength_by_joint={
                    joint: float(clean.strength_by_joint[k, machine.index(joint)])
                    for joint in measured_joints(machine)
                },
            )
        )
    return entries


def check_place(path: Path, bag: Path) -> None:
    """`ConfigurationError` for a label in the bag's folder, `DataError` for one that exists."""
    if path.resolve().is_relative_to(bag.resolve()):
        raise ConfigurationError(
            f"--label {path}: lies in the folder of the bag, {bag}, which must not tell what is "
            "hidden; name a file elsewhere"
        )
    if path.suffix != ".json":
        raise ConfigurationError(f"--label {path}: the suffix of a label is .json")
    for file in (path, clean_path(path)):
        if file.exists():
            raise DataError(f"{file}: exists; name a label that does not exist yet")


def clean_path(path: Path) -> Path:
    """Where the arrays lie that belong to a label."""
    return path.with_suffix(".npz")


def write_label(
    path: Path,
    bag: Path,
    seed: int,
    machine: Machine,
    stand_in: StandIn,
    planted: Sequence[Planted],
    clean: Clean,
) -> None:
    """The label of a bag and, beside it, the arrays of `clean`."""
    check_place(path, bag)
    content = Label(
        bag=bag.name,
        seed=seed,
        clean=clean_path(path).name,
        machine=_digest(machine, stand_in),
        effects=label(planted, clean, machine),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    content.write(path)
    clean.save(clean_path(path))


def load_hidden(path: Path, machine: Machine, stand_in: StandIn) -> Spec:
    """What a machine hides by the file of a spec, or by the label of a bag of that machine.

    `ConfigurationError` if the file is wrong, or the label that of another machine.
    """
    if path.suffix != ".json":
        return check_joints(load_spec(path), machine, path)
    try:
        content = Label.read(path)
    except DataError as error:
        raise ConfigurationError(
            f"{error}; give a label that --label has written, or a spec (YAML)"
        ) from None
    effects = [
        {
            "effect": entry.name,
            "joint": entry.joint,
            "form": entry.form,
            "parameters": {one.name: one.value for one in entry.parameters},
        }
        for entry in content.effects
    ]
    if content.machine != _digest(machine, stand_in):
        raise ConfigurationError(
            f"{path}: the label of another machine than '{stand_in.name}' with the geometry of "
            f"'{machine.name}'; give the files --plant and --machine that its bag was made with"
        )
    return check_joints(validate({"effects": effects}, Spec, path), machine, path)


def _digest(machine: Machine, stand_in: StandIn) -> str:
    """Tells machines apart, whatever their names."""
    text = machine.model_dump_json() + stand_in.model_dump_json()
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
