"""What is known of parameters before any recording: a Gaussian prior, from a file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from pydantic import model_validator
from scipy.linalg import orth

from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model

Three = tuple[float, float, float]


class KnownBody(Schema):
    """A body as CAD has it, in the frame of its link, which a row `dh` puts at the far end.

    With R the radius of gyration about that frame's origin, one standard deviation is
    `relative_std_dev` times m for the mass, m R for mass moments, m R^2 for inertias.
    """

    mass: Positive  # kg
    centre_of_mass: Three  # m
    inertia: tuple[Positive, Positive, Positive]  # kg m2, xx, yy, zz about the centre of mass
    products: Three = (0.0, 0.0, 0.0)  # kg m2, xy, xz, yz
    relative_std_dev: Positive

    @model_validator(mode="after")
    def _realizable(self) -> Self:
        if np.linalg.eigvalsh(0.5 * np.trace(self.tensor) * np.eye(3) - self.tensor)[0] < 0.0:
            raise ValueError(
                f"inertia {list(self.inertia)}, products {list(self.products)}: no distribution of "
                "mass has these; the largest may not exceed the sum of the other two"
            )
        return self

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) about the centre of mass."""
        (xx, yy, zz), (xy, xz, yz) = self.inertia, self.products
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def ten(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The ten parameters of `crane_model.chain` and their standard deviations, (10,) each.

        `frame` (4, 4) is that of the link in the frame of the body.
        """
        turn, centre = frame[:3, :3], frame[:3, :3] @ self.centre_of_mass + frame[:3, 3]
        about = self.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        inertia = turn @ self.tensor @ turn.T + about
        xx, xy, xz, yy, yz, zz = inertia[np.triu_indices(3)]
        second = 0.5 * float(np.trace(inertia))  # m R^2
        radius = np.sqrt(second / self.mass)
        scale = np.array([self.mass, *[self.mass * radius] * 3, *[second] * 6])
        values = np.array([self.mass, *(self.mass * centre), xx, xy, yy, xz, yz, zz])
        return values, self.relative_std_dev * scale


class KnownParameter(Schema):
    """A parameter of the model in its unit."""

    value: float
    std_dev: Positive


class PriorFile(Schema):
    """What is known of single parameters, by name, and of the bodies of all joints."""

    parameters: dict[str, KnownParameter] = {}
    bodies: dict[str, KnownBody] = {}


class PriorEntry(NamedTuple):
    """One parameter or body of a prior file.

    `name` as in the file, `known` its value in words (empty for a body), `span` (k, r): orthonormal
    directions, among the k rows of the prior, that the entry takes part in.
    """

    name: str
    known: str
    span: np.ndarray


@dataclass(frozen=True)
class Prior:
    """Independent rows `matrix` Θ = `values`, each with the standard deviation 1: (k, p), (k,).

    `entries` are the lines of the file that the rows come from.
    """

    matrix: np.ndarray
    values: np.ndarray
    entries: tuple[PriorEntry, ...] = ()


def load_prior(path: Path | str, model: Model) -> Prior:
    """The prior in `path` for the parameters of `model`; `ConfigurationError` names what is wrong.

    Bodies are brought into the combinations that the model has of them.
    """
    content = load(path, PriorFile)
    names = [parameter.name for parameter in model.parameters]
    if unknown := content.parameters.keys() - set(names):
        raise ConfigurationError(
            f"{path}: parameters: model '{model.name}' has no '{min(unknown)}'; it has "
            f"{', '.join(names)}"
        )
    rows = [
        (np.eye(len(names))[names.index(name)] / known.std_dev, known.value / known.std_dev)
        for name, known in content.parameters.items()
    ]
    matrices, values = [row for row, _ in rows], [value for _, value in rows]
    parts: dict[str, np.ndarray] = {}
    if content.bodies:
        combined, means, parts = _of_bodies(model, content.bodies, path)
        matrices += list(combined)
        values += list(means)
    if not matrices:
        raise ConfigurationError(f"{path}: neither parameters nor bodies are known; name some")
    unit, singles = np.eye(len(matrices)), len(content.parameters)
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    entries = [
        PriorEntry(name, f"{known.value:g} ± {known.std_dev:g} {units[name]}", unit[:, [i]])
        for i, (name, known) in enumerate(content.parameters.items())
    ]
    entries += [
        PriorEntry(f"body {name}", "", unit[:, singles:] @ orth(part))
        for name, part in parts.items()
    ]
    return Prior(np.array(matrices), np.array(values), tuple(entries))


def _of_bodies(
    model: Model, bodies: Mapping[str, KnownBody], path: Path | str
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Whitened rows (r, p), their values (r,), and what of them (r, 10) is of each body."""
    machine = _machine(model, bodies, path)
    known = [bodies[joint.name].ten(joint.after) for joint in machine.joints]
    mean, spread = (np.concatenate(parts) for parts in zip(*known, strict=True))
    for term in model.terms:
        combination = term.of_bodies(model.setting)
        if combination is None:
            continue
        covariance = (combination * spread**2) @ combination.T
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        matrix = np.zeros((len(covariance), len(model.parameters)))
        matrix[:, model.part(term)] = whitening
        shares = np.split(whitening @ combination * spread, len(machine.joints), axis=1)
        parts = {joint.name: part for joint, part in zip(machine.joints, shares, strict=True)}
        return matrix, whitening @ combination @ mean, parts
    raise ConfigurationError(
        f"{path}: bodies: no term of model '{model.name}' is of the bodies of a machine; "
        "serial_rigid_body is"
    )


def _machine(model: Model, bodies: Mapping[str, KnownBody], path: Path | str) -> Machine:
    if model.machine is None:
        raise ConfigurationError(f"{path}: bodies: model '{model.name}' has no machine")
    joints = [joint.name for joint in model.machine.joints]
    if set(joints) != bodies.keys():
        raise ConfigurationError(
            f"{path}: bodies: give that of each joint of {model.machine.name}, "
            f"{', '.join(joints)}; got {', '.join(bodies)}"
        )
    return model.machine
