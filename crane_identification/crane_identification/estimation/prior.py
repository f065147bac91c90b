"""A Gaussian prior of parameters, from a file."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from pydantic import model_validator
from scipy.linalg import block_diag, orth

from crane_model.chain.body_regressor import pseudo_inertia
from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.model_file import Model

Three = tuple[float, float, float]
THIN = 1e-9
"""Ratio of second moments of a body below which it counts as a plate or a rod without thickness."""


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
        if self.second_moments[0] < -THIN * self.second_moments[-1]:
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

    @property
    def second_moments(self) -> np.ndarray:
        """(3,) about the principal axes through the centre of mass, rising [kg m2]."""
        moments: np.ndarray = np.linalg.eigvalsh(
            0.5 * np.trace(self.tensor) * np.eye(3) - self.tensor
        )
        return moments

    def ten(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The ten parameters of `crane_model.chain` and their standard deviations, (10,) each.

        `frame` (4, 4) is that of the link in the frame of the body.
        """
        turn, centre = frame[:3, :3], frame[:3, :3] @ self.centre_of_mass + frame[:3, 3]
        about = self.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        inertia = turn @ self.tensor @ turn.T + about
        xx, xy, xz, yy, yz, zz = inertia[np.triu_indices(3)]
        values = np.array([self.mass, *(self.mass * centre), xx, xy, yy, xz, yz, zz])
        return values, self.relative_std_dev * size_of(values)


def size_of(ten: np.ndarray) -> np.ndarray:
    """(10,) m, m R and m R^2 of a body (10,), in the places of its ten parameters."""
    second = 0.5 * float(ten[4] + ten[6] + ten[9])  # m R^2
    return np.array([ten[0], *[np.sqrt(ten[0] * second)] * 3, *[second] * 6])


class KnownParameter(Schema):
    """A parameter of the model in its unit."""

    value: float
    std_dev: Positive


class Measure(StrEnum):
    """How the distance of a body from the known one is measured.

    GAUSSIAN: each of the ten parameters has its standard deviation; bodies that cannot exist are as
    likely as others. LOG_DET: the divergence of the pseudo-inertias (Lee, Wensing and Park 2019),
    which is infinite for those, and the same in any frame.
    """

    GAUSSIAN = "gaussian"
    LOG_DET = "log_det"


class PriorFile(Schema):
    """Prior of single parameters, by name, and of the bodies of all joints."""

    parameters: dict[str, KnownParameter] = {}
    bodies: dict[str, KnownBody] = {}
    measure: Measure = Measure.GAUSSIAN


@dataclass(frozen=True)
class KnownBodies:
    """Bodies from which the log-det divergence counts.

    `pseudo_inertia` (m, 4, 4) about the frames of their links. With `relative_std_dev` (m,) alone
    vary, each by itself, the mass and the second moments along the principal axes through the
    centre of mass; the centre by 0.71 times that part of a radius of gyration. Of the rows of the
    prior, the last `rows` are the Gaussian of the same curvature.
    """

    pseudo_inertia: np.ndarray
    relative_std_dev: np.ndarray
    rows: int


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

    `entries` are the lines of the file that the rows come from. The divergence from `bodies`
    replaces their rows, which stand last; None: the rows count.
    """

    matrix: np.ndarray
    values: np.ndarray
    entries: tuple[PriorEntry, ...] = ()
    bodies: KnownBodies | None = None

    @property
    def wording(self) -> str:
        return "prior" if self.bodies is None else "log-det prior"


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
    known, parts = None, dict[str, np.ndarray]()
    if content.bodies:
        combined, means, known, parts = _of_bodies(model, content.bodies, content.measure, path)
        matrices += list(combined)
        values += list(means)
    if not matrices:
        raise ConfigurationError(f"{path}: neither parameters nor bodies are known; name some")
    unit, singles = np.eye(len(matrices)), len(content.parameters)
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    entries = [
        PriorEntry(name, f"{entry.value:g} ± {entry.std_dev:g} {units[name]}", unit[:, [i]])
        for i, (name, entry) in enumerate(content.parameters.items())
    ]
    entries += [
        PriorEntry(f"body {name}", "", unit[:, singles:] @ orth(part))
        for name, part in parts.items()
    ]
    return Prior(np.array(matrices), np.array(values), tuple(entries), known)


def _of_bodies(
    model: Model, bodies: Mapping[str, KnownBody], measure: Measure, path: Path | str
) -> tuple[np.ndarray, np.ndarray, KnownBodies | None, dict[str, np.ndarray]]:
    """Whitened rows (r, p), their values (r,), and what of them (r, 10) is of each body."""
    if model.machine is None:
        raise ConfigurationError(f"{path}: bodies: model '{model.name}' has no machine")
    machine = model.machine
    mean, spread = (part.ravel() for part in ten_of_bodies(machine, bodies, path))
    listed = [bodies[joint.name] for joint in machine.joints]
    covariance, known = np.diag(spread**2), None
    if measure is Measure.LOG_DET:
        tensors = pseudo_inertia(mean.reshape(-1, 10))
        if thin := [
            joint.name
            for joint, body in zip(machine.joints, listed, strict=True)
            if body.second_moments[0] <= THIN * body.second_moments[-1]
        ]:
            raise ConfigurationError(
                f"{path}: bodies: {', '.join(thin)}: measure {measure} needs bodies with an extent "
                "in all directions; here the largest moment of inertia equals the sum of the other "
                f"two; make it smaller, or choose measure {Measure.GAUSSIAN}"
            )
        deviations = np.array([body.relative_std_dev for body in listed])
        covariance = block_diag(
            *(d**2 * _inverse_curvature(P) for d, P in zip(deviations, tensors, strict=True))
        )
    for term in model.terms:
        combination = term.of_bodies(model.setting)
        if combination is None:
            continue
        if measure is Measure.LOG_DET:
            if term.has_base_parameters:
                raise ConfigurationError(
                    f"{path}: measure {measure}: term '{term.type}' has bodies in the plane; "
                    f"choose the term 'serial_rigid_body', or measure {Measure.GAUSSIAN}"
                )
            known = KnownBodies(tensors, deviations, len(combination))
        whitening = np.linalg.inv(np.linalg.cholesky(combination @ covariance @ combination.T))
        matrix = np.zeros((len(combination), len(model.parameters)))
        matrix[:, model.part(term)] = whitening
        shares = whitening @ combination @ np.linalg.cholesky(covariance)
        ten_each = np.split(shares, len(machine.joints), axis=1)
        parts = {joint.name: part for joint, part in zip(machine.joints, ten_each, strict=True)}
        return matrix, whitening @ combination @ mean, known, parts
    raise ConfigurationError(
        f"{path}: bodies: no term of model '{model.name}' is of the bodies of a machine; "
        "serial_rigid_body is"
    )


def _inverse_curvature(P: np.ndarray) -> np.ndarray:
    """(10, 10): inverse of the matrix of tr((P⁻¹ δP)²), as a form of the ten parameters of δP."""
    steps = pseudo_inertia(np.eye(10))
    scale = np.linalg.inv(np.linalg.cholesky(P))
    whitened = (scale @ steps @ scale.T).reshape(10, -1)
    inverse: np.ndarray = np.linalg.inv(whitened @ whitened.T)
    return inverse


def ten_of_bodies(
    machine: Machine, bodies: Mapping[str, KnownBody], path: Path | str
) -> tuple[np.ndarray, np.ndarray]:
    """The ten parameters of each body of a machine, in the frames of its chain, and their standard
    deviations, (m, 10) each; `ConfigurationError` if `bodies` in `path` are of other joints.
    """
    joints = [joint.name for joint in machine.joints]
    if set(joints) != bodies.keys():
        raise ConfigurationError(
            f"{path}: bodies: give that of each joint of {machine.name}, "
            f"{', '.join(joints)}; got {', '.join(bodies)}"
        )
    ten = [bodies[joint.name].ten(joint.after) for joint in machine.joints]
    means, spreads = (np.array(parts) for parts in zip(*ten, strict=True))
    return means, spreads
