"""Which effects are to be hidden: a YAML file."""

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from crane_model.configuration import Schema, load
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_sim.effects.form import Form
from crane_sim.effects.forms import FORMS


class HiddenEffect(Schema):
    """One effect: of a given strength, or with its magnitude among the `parameters`.

    `strength` is the share of the drive force, rms over rms, that the effect is to have; parameters
    that are not given are drawn. `form` is the first of the effect by default.
    """

    effect: str
    joint: str | None = None
    form: str | None = None
    strength: Annotated[float, Field(gt=0, le=0.5)] | None = None
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
        if (self.strength is None) != (form.magnitude.name in self.parameters):
            raise ValueError(
                f"'{self.effect}': give either its strength or its parameter {known[0]}"
            )
        return self

    @property
    def law(self) -> Form:
        """The form that is meant."""
        forms = FORMS[self.effect]
        return next((form for form in forms if form.name == self.form), forms[0])


class Spec(Schema):
    """Effects that one machine hides; `seed` is that of the parameters which are drawn.

    Strengths are those on one period of `trajectory`, by default the packaged excitation.
    """

    seed: int = 0
    trajectory: Path | None = None
    effects: tuple[HiddenEffect, ...] = ()


def load_spec(path: Path | str) -> Spec:
    """The file `path`; `ConfigurationError` if it is wrong. Its trajectory lies beside it."""
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
