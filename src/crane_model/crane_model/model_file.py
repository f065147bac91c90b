"""The model: a sum of terms with values, standard deviations and provenance, kept in YAML."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, compress
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, SerializeAsAny

import crane_machines
from crane_model.array import Array
from crane_model.configuration import Schema, load, save, validate
from crane_model.errors import ConfigurationError
from crane_model.hydraulics import HydraulicValues
from crane_model.machine import Machine, load_machine
from crane_model.motion_columns import MotionColumn, fill
from crane_model.record import Record
from crane_model.terms import Parameter, Term, term_from_mapping
from crane_model.terms.term import Setting


@dataclass(frozen=True)
class Model:
    """tau = sum of terms (16): its regressor Phi (28) and, once estimated, its Theta.

    Parameters
    ----------
    name
        What messages call it.
    setting
        The joints with their units, and the machine.
    terms
        Summands of the generalized force.
    values, std_devs
        (p,) Theta and its standard deviations, in the order and units of `parameters`.
    provenance
        Where the values come from.
    hydraulics
        Of the machine, if they were identified.
    """

    name: str
    setting: Setting
    terms: tuple[Term, ...]
    values: Array | None = None  # (p,) Theta
    std_devs: Array | None = None  # (p,)
    provenance: str = ""
    hydraulics: HydraulicValues | None = None  # of the machine, where they were identified

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, the columns of every (n, j) array."""
        return tuple(self.setting.units)

    @property
    def machine(self) -> Machine | None:
        """The machine whose geometry the terms use; None for a machine without one."""
        return self.setting.machine

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Name, unit, sign and meaning of each of the p entries of Theta."""
        parameters = [p for term in self.terms for p in term.parameters(self.setting)]
        names = [p.name for p in parameters]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigurationError(
                f"model '{self.name}': parameter {', '.join(twice)} stands twice; "
                "list each term once per joint"
            )
        return tuple(parameters)

    def regressor(self, record: Record) -> Array:
        """Phi of (28) on n samples: (n, j, p)."""
        columns = np.zeros((*record.position.shape, len(self.parameters)))
        self.fill(record, columns)
        return columns

    def fill(self, record: Record, columns: Array, smooth: bool = False) -> None:
        """Write Phi of (28) into `columns` (n, j, p), which comes as zeros.

        `smooth`: q' sgn(q') in place of |q'|, smooth in q' where the record's direction is.
        """
        for term, part in self.whole_terms:
            term.fill(record, self.setting, columns[:, :, part])
        fill(self.motion_columns, record, columns, smooth)

    @cached_property
    def whole_terms(self) -> tuple[tuple[Term, slice], ...]:
        """The terms that have no `motion_columns`, with their columns of Phi."""
        every = zip(self.terms, self._parts, strict=True)
        return tuple(pair for pair in every if not pair[0].motion_columns(self.setting))

    @cached_property
    def motion_columns(self) -> tuple[MotionColumn, ...]:
        """Those of all terms, in the columns of Phi."""
        return tuple(
            column._replace(parameter=part.start + column.parameter)
            for term, part in zip(self.terms, self._parts, strict=True)
            for column in term.motion_columns(self.setting)
        )

    def part(self, term: Term) -> slice:
        """Which parameters, columns of Phi, belong to one of the model's terms."""
        return self._parts[self.terms.index(term)]

    @property
    def base_parameters(self) -> slice | None:
        """Which parameters are those of (8), of the planar bodies; None if it has none."""
        parts = zip(self.terms, self._parts, strict=True)
        return next((part for term, part in parts if term.has_base_parameters), None)

    @cached_property
    def _parts(self) -> tuple[slice, ...]:
        """Which columns of Phi belong to each term."""
        counts = [len(term.parameters(self.setting)) for term in self.terms]
        ends = accumulate(counts)
        return tuple(slice(end - count, end) for end, count in zip(ends, counts, strict=True))

    def predict(self, record: Record) -> Array:
        """Generalized forces Phi Theta on n samples: (n, j) [N m, N]."""
        # one product of all rows; matmul would take them sample by sample
        return np.tensordot(self.regressor(record), self.theta, axes=1)

    def range_at_standstill(self, record: Record) -> tuple[Array, Array]:
        """Least and largest force, (n, j) each, between the branches of friction up and down.

        Where a joint stands, (13) is set-valued: the force is anything in between.
        """
        ahead = np.ones_like(record.position)
        up = self.predict(replace(record, direction_known=ahead))
        down = self.predict(replace(record, direction_known=-ahead))
        return np.minimum(up, down), np.maximum(up, down)

    def gravity(self, record: Record) -> Array:
        """The part of the force that gravity alone needs at the record's positions: (n, j)."""
        return self._force_of(record.at_rest(), [term.has_weight() for term in self.terms])

    def friction(self, record: Record) -> Array:
        """The part of the force that friction takes, sgn as the record has it: (n, j)."""
        return self._force_of(record, [term.is_friction() for term in self.terms])

    def _force_of(self, record: Record, counts: Sequence[bool]) -> Array:
        columns = self.regressor(record)
        for counted, part in zip(counts, self._parts, strict=True):
            if not counted:
                columns[:, :, part] = 0.0
        return columns @ self.theta

    @property
    def theta(self) -> Array:
        """Theta (p,); `ConfigurationError` if the model has not been estimated."""
        if self.values is None:
            raise ConfigurationError(
                f"model '{self.name}' has no values yet; fit it to data with identify"
            )
        return self.values

    def with_estimate(self, values: Array, std_devs: Array, provenance: str) -> Self:
        """The same model with Theta, its standard deviations and where they come from."""
        return replace(self, values=values, std_devs=std_devs, provenance=provenance)

    def with_term(self, term: Term) -> Self:
        """The model extended by one term; its values are dropped, for all must be fitted anew."""
        return self._of((*self.terms, term))

    def without_term(self, term: Term) -> Self:
        """The model without one of its terms, and without values."""
        return self._of(tuple(kept for kept in self.terms if kept != term))

    def of_machine(self) -> Self:
        """The model, with its values, without what single recordings carried."""
        stays = [not term.of_recordings for term in self.terms]
        if all(stays):
            return self
        wanted = np.concatenate(
            [np.arange(len(self.parameters))[part] for part in compress(self._parts, stays)]
        )
        known, spread = (
            None if given is None else given[wanted] for given in (self.values, self.std_devs)
        )
        return replace(
            self, terms=tuple(compress(self.terms, stays)), values=known, std_devs=spread
        )

    def _of(self, terms: tuple[Term, ...]) -> Self:
        return replace(self, terms=terms, values=None, std_devs=None, provenance="")


class _Value(Schema):
    name: str
    unit: str
    value: float
    std_dev: Annotated[float, Field(ge=0)]


class _Estimate(Schema):
    provenance: str
    parameters: tuple[_Value, ...]


class _ModelFile(Schema):
    name: str
    machine: dict[str, Any] | str | None = None
    joints: dict[str, Literal["rad", "m"]] = Field(min_length=1)
    terms: tuple[Annotated[SerializeAsAny[Term], BeforeValidator(term_from_mapping)], ...] = Field(
        min_length=1
    )
    estimate: _Estimate | None = None
    hydraulics: HydraulicValues | None = None


def load_model(path: Path | str) -> Model:
    """Read a model file.

    Parameters
    ----------
    path
        The file. Its `machine` is a machine file beside it, the machine itself, the name of a
        machine that ships with the suite, or absent for a machine without linkages.

    Returns
    -------
    The model, with values and hydraulics if the file has them.

    Raises
    ------
    ConfigurationError
        Names file, key and what is wrong.

    Examples
    --------
    >>> from crane_model.machine_files import machine_file
    >>> model = load_model(machine_file("model.yaml"))
    >>> model.joints
    ('inner_boom', 'outer_boom', 'telescope')
    >>> len(model.parameters), model.parameters[6].name
    (20, 'm_TL')
    """
    path = Path(path)
    content = load(path, _ModelFile)
    setting = Setting(content.joints, _machine(content.machine, path))
    model = Model(content.name, setting, content.terms, hydraulics=content.hydraulics)
    machine = setting.machine
    if machine is not None and not content.joints.items() <= machine.units.items():
        raise ConfigurationError(
            f"{path}: key 'joints': {machine.name} has the joints {_units(machine.units)}, of "
            f"which a model takes any in any order; got {_units(content.joints)}"
        )
    _check_hydraulics(model, path)
    try:
        names = [(p.name, p.unit) for p in model.parameters]
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    if content.estimate is None:
        return model
    given = [(p.name, p.unit) for p in content.estimate.parameters]
    if given != names:
        raise ConfigurationError(
            f"{path}: key 'estimate.parameters': must list {_listed(names)} in this order, "
            f"got {_listed(given)}"
        )
    return model.with_estimate(
        np.array([p.value for p in content.estimate.parameters]),
        np.array([p.std_dev for p in content.estimate.parameters]),
        content.estimate.provenance,
    )


def save_model(path: Path | str, model: Model) -> None:
    """Write a model file that `load_model` reads back; it carries its machine with it.

    Parameters
    ----------
    path
        File to write, or to write over.
    model
        The model, estimated or not.

    Raises
    ------
    ConfigurationError
        If a value or standard deviation is not finite.

    Examples
    --------
    >>> from crane_model.terms.single_axis import Inertia
    >>> axis = Model("axis", Setting({"axis": "rad"}, None), (Inertia(joint="axis"),))
    >>> save_model("axis.yaml", axis.with_estimate(np.array([2.5]), np.array([0.1]), "by hand"))
    >>> load_model("axis.yaml").theta
    array([2.5])
    """
    estimate = None
    if model.values is not None and model.std_devs is not None:
        found = zip(model.parameters, model.values, model.std_devs, strict=True)
        estimate = {
            "provenance": model.provenance,
            "parameters": [
                {"name": p.name, "unit": p.unit, "value": float(value), "std_dev": float(std)}
                for p, value, std in found
            ],
        }
    machine = None if model.machine is None else model.machine.model_dump(exclude_none=True)
    content: dict[str, Any] = {
        "name": model.name,
        "machine": machine,
        "joints": dict(model.setting.units),
        "terms": tuple(term.model_dump() for term in model.terms),
        "estimate": estimate,
        "hydraulics": None if model.hydraulics is None else model.hydraulics.model_dump(),
    }
    save(path, validate(content, _ModelFile, path))


def _machine(given: dict[str, Any] | str | None, model_path: Path) -> Machine | None:
    if given is None:
        return None
    if isinstance(given, dict):
        return validate(given, Machine, f"{model_path}: machine")
    if given in crane_machines.shipped():
        return load_machine(given)
    return load_machine(model_path.parent / given)


def _check_hydraulics(model: Model, path: Path) -> None:
    if model.hydraulics is None:
        return
    if model.machine is None:
        raise ConfigurationError(f"{path}: key 'hydraulics': needs a machine with cylinders")
    there = model.machine.joint_names
    if unknown := sorted(model.hydraulics.joints.keys() - set(there)):
        raise ConfigurationError(
            f"{path}: key 'hydraulics.joints': {', '.join(unknown)}: no joint of the machine; "
            f"it has {', '.join(there)}"
        )


def _units(joints: Mapping[str, str]) -> str:
    return ", ".join(f"{joint} [{unit}]" for joint, unit in joints.items())


def _listed(parameters: list[tuple[str, str]]) -> str:
    return ", ".join(f"{name} [{unit}]" for name, unit in parameters)
