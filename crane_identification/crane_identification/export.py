"""`export`: an identified model as URDF or MJCF, for simulators and planners.

Recordings determine combinations of the bodies' parameters, simulators ask for all ten of each
body. The exported bodies have exactly the combinations that were identified; of all such bodies
they are the nearest to a prior, by the log-det divergence of `estimation.consistent`. The prior is
a prior file, or the links of the machine file as bars. A combination counts as identified if its
standard deviation is below that of the prior.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crane_identification.estimation.consistent import physics
from crane_identification.estimation.prior import PriorFile, size_of, ten_of_bodies
from crane_identification.notation import plain
from crane_model import cli
from crane_model.base_parameters import standard_from_chain
from crane_model.chain.body_regressor import PER_BODY, TEN_FROM_PSEUDO_INERTIA, pseudo_inertia
from crane_model.configuration import load
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.model_file import Model, load_model
from crane_model.urdf import JointFriction, LinkInertia, link_bars, urdf

BAR_DENSITY = 1000.0
"""Assumed density of links as solid bars [kg/m3]: about that of hollow steel booms."""
ROW_SPACE_TOLERANCE = 1e-6
"""Share of a parameter's direction below which it is not seen, or is nothing but seen."""
FRICTION_TERMS = ("coulomb", "viscous")


class IdentifiedBodies(NamedTuple):
    """All bodies of a machine of m joints, and what recordings tell of each parameter."""

    ten: np.ndarray
    """(m, 10) of `crane_model.chain` in the frames of the joints [kg, kg m, kg m2]."""
    identified: np.ndarray
    """(m, 10) truth values: the recordings alone determine the parameter."""
    combined: np.ndarray
    """(m, 10) truth values: the recordings determine combinations with others only."""


def identified_bodies(model: Model, prior: Path | str | None = None) -> IdentifiedBodies:
    """Return bodies that have the identified rigid-body parameters of a model.

    Parameters
    ----------
    model
        Identified model of a machine, with a term of its rigid bodies.
    prior
        Prior file with the bodies of all joints; by default the links of the machine file count as
        bars of the density of water.

    Returns
    -------
    IdentifiedBodies
        The bodies nearest to the prior by the sum of log-det divergences.

    Raises
    ------
    ConfigurationError
        The model has no values, no machine or no term of rigid bodies, or the prior lacks bodies.
    DataError
        No bodies have the parameters.

    Notes
    -----
    Lee, Wensing and Park (2019), Geometric robot dynamic identification: a convex programming
    approach; here under the constraint of the identified combinations.

    Examples
    --------
    >>> from crane_model import load_model
    >>> from crane_model.machine_files import machine_file
    >>> model = load_model(machine_file("model.yaml"))
    >>> values = [31750, 7050, 0, 3140, 1820, 30, 150, 340, *[100.0] * 12]
    >>> model = model.with_estimate(np.array(values), np.ones(20), "by hand")
    >>> bodies = identified_bodies(model)
    >>> bodies.ten[-1, 0].round(6)  # mass of telescope and gripper, m_TL
    np.float64(150.0)
    """
    machine, bodies = model.machine, physics(model).bodies
    if machine is None or bodies is None:
        raise ConfigurationError(
            f"model '{model.name}': has no bodies to export; give it a machine and the term "
            "serial_rigid_body, and identify it again"
        )
    if not bodies.definite.all():
        which = [
            name for name, exists in zip(bodies.names, bodies.definite, strict=True) if not exists
        ]
        raise ConfigurationError(
            f"model '{model.name}': key 'zero' leaves {', '.join(which)} without mass or inertia, "
            "which no simulator takes; leave out m, Ixx, Iyy, Izz there, and identify it again"
        )
    to_planar = np.eye(10 * len(machine.joints))
    if not bodies.in_space:
        to_planar = standard_from_chain(machine)
    before, spread = _before(machine, prior)
    combinations = bodies.base @ to_planar
    values, std_devs = model.theta[bodies.part], _std_devs(model)[bodies.part]
    known = std_devs < np.linalg.norm(combinations * spread.ravel(), axis=1)
    if not known.any():
        raise DataError(
            f"model '{model.name}': the prior knows its rigid bodies better than the recordings "
            "do; record motions that show them, and identify it again"
        )
    rows = np.vstack([combinations[known], bodies.none @ to_planar])
    wanted = np.concatenate([values[known], np.zeros(len(bodies.none))])
    ten = _nearest(rows, wanted, before, before[:, 0] / spread[:, 0], model.name)
    scaled = rows * np.abs(ten).max(axis=1).repeat(10)
    _, sizes, directions = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=1, keepdims=True))
    rank = int((sizes > ROW_SPACE_TOLERANCE * sizes[0]).sum())
    seen = np.sum(directions[:rank] ** 2, axis=0).reshape(-1, 10)
    alone = seen > 1.0 - ROW_SPACE_TOLERANCE
    return IdentifiedBodies(ten, alone, ~alone & (seen > ROW_SPACE_TOLERANCE))


def _before(machine: Machine, prior: Path | str | None) -> tuple[np.ndarray, np.ndarray]:
    """The bodies of the prior and their standard deviations, (m, 10) each."""
    if prior is not None:
        ten, std_devs = ten_of_bodies(machine, load(prior, PriorFile).bodies, prior)
        least = np.linalg.eigvalsh(pseudo_inertia(ten))[:, 0]
        if (least <= 0.0).any():
            raise ConfigurationError(
                f"{prior}: bodies: {machine.joints[int(np.argmin(least))].name} has no extent in "
                "some direction; make its largest moment of inertia smaller"
            )
        return ten, std_devs
    bars = np.array([_bar(end, width) for end, width in link_bars(machine)])
    return bars, np.array([size_of(bar) for bar in bars])


def _std_devs(model: Model) -> np.ndarray:
    """(p,) infinite where the model file does not give them."""
    return np.full(len(model.theta), np.inf) if model.std_devs is None else model.std_devs


def _bar(end: np.ndarray, width: float) -> np.ndarray:
    """(10,) of a bar of square section from the origin to `end`."""
    reach = float(np.linalg.norm(end))
    length, along = max(reach, width), end / (reach or 1.0)
    P = np.zeros((4, 4))
    P[:3, :3] = (width**2 * np.eye(3) + (length**2 - width**2) * np.outer(along, along)) / 12.0
    P[:3, :3] += np.outer(end, end) / 4.0
    P[:3, 3] = P[3, :3] = end / 2.0
    P[3, 3] = 1.0
    mass = BAR_DENSITY * length * width**2
    ten: np.ndarray = np.einsum("sij,ij->s", TEN_FROM_PSEUDO_INERTIA, mass * P)
    return ten


def _nearest(
    rows: np.ndarray, wanted: np.ndarray, before: np.ndarray, weights: np.ndarray, name: str
) -> np.ndarray:
    """(m, 10) with `rows` (r, 10 m) @ them = `wanted` (r,) that are nearest to `before` (m, 10).

    The divergence of each body counts `weights` (m,) squared.
    """
    import cvxpy  # two seconds, for those who need them

    factors = np.linalg.cholesky(pseudo_inertia(before))
    variables: list[Any] = [cvxpy.Variable((4, 4), symmetric=True) for _ in before]
    moments = np.einsum("mai,sab,mbj->msij", factors, TEN_FROM_PSEUDO_INERTIA, factors)
    ten = cvxpy.hstack(
        [
            of_body.reshape(10, -1) @ cvxpy.vec(X, order="C")
            for of_body, X in zip(moments, variables, strict=True)
        ]
    )
    sizes = np.linalg.norm(rows * np.abs(before).max(axis=1).repeat(10), axis=1)
    importance = (weights / weights.max()) ** 2
    divergence = sum(
        weight * (cvxpy.trace(X) - cvxpy.log_det(X))
        for weight, X in zip(importance, variables, strict=True)
    )
    same = (rows / sizes[:, np.newaxis]) @ ten == wanted / sizes
    problem = cvxpy.Problem(cvxpy.Minimize(divergence), [same])
    try:
        problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.error.SolverError as error:
        raise _no_bodies(name, str(error)) from None
    if problem.status not in (cvxpy.OPTIMAL, cvxpy.OPTIMAL_INACCURATE):
        raise _no_bodies(name, problem.status)
    found: np.ndarray = ten.value
    scale = np.abs(before).max(axis=1).repeat(10)
    found = found + scale * np.linalg.lstsq(rows * scale, wanted - rows @ found, rcond=None)[0]
    if (np.linalg.eigvalsh(pseudo_inertia(found.reshape(-1, 10))) <= 0.0).any():
        raise _no_bodies(name, "the nearest ones have no positive inertia")
    return found.reshape(-1, 10)


def _no_bodies(name: str, why: str) -> DataError:
    return DataError(
        f"model '{name}': no bodies have its rigid-body parameters ({why}); identify it with "
        "--estimator consistent, and with a term rotor_inertia for each motor"
    )


def export_urdf(model: Model, prior: Path | str | None = None) -> str:
    """Return an identified model as URDF, with inertias and friction.

    Parameters
    ----------
    model
        Identified model, as `identified_bodies` takes it.
    prior
        Prior file for what recordings do not determine, as `identified_bodies` takes it.

    Returns
    -------
    Text of a URDF in SI units. Comments mark which values are identified and which are from the
    prior, and list the terms of the model that a URDF cannot hold.

    Raises
    ------
    ConfigurationError, DataError
        As `identified_bodies`.

    Examples
    --------
    >>> from crane_model import load_model
    >>> from crane_model.machine_files import machine_file
    >>> model = load_model(machine_file("model.yaml", "single_axis"))
    >>> values = np.array([400.0, 300.0, 10.0, 80.0, 0.0, 50.0, 0.0])
    >>> text = export_urdf(model.with_estimate(values, 0.01 * np.ones(7), "by hand"))
    >>> "identified alone" in text, 'damping="50.0" friction="80.0"' in text
    (True, True)
    """
    model = model.of_machine()
    bodies = identified_bodies(model, prior)
    assert model.machine is not None  # identified_bodies refuses such a model
    source = "bars along the links of the machine file" if prior is None else Path(prior).name
    inertias = {
        joint.name: LinkInertia(ten, f"{joint.name}: {_sources(identified, combined, source)}")
        for joint, ten, identified, combined in zip(model.machine.joints, *bodies, strict=True)
    }
    friction = {joint: _friction(model, joint) for joint in model.joints}
    return urdf(model.machine, inertias, friction, _comments(model, model.machine, source))


def _sources(identified: np.ndarray, combined: np.ndarray, source: str) -> str:
    shares = {
        "identified alone": identified,
        "identified in combination with other values": combined,
        f"not identified, from {source}": ~identified & ~combined,
    }
    return "; ".join(
        f"{words}: {', '.join(np.array(PER_BODY)[which])}"
        for words, which in shares.items()
        if which.any()
    )


def _friction(model: Model, joint: str) -> JointFriction:
    """Coulomb and viscous friction; zero where it is not determined."""
    values, words = dict.fromkeys(FRICTION_TERMS, 0.0), []
    for term in model.terms:
        if term.type not in FRICTION_TERMS or term.only_joint != joint:
            continue
        (k,) = range(len(model.parameters))[model.part(term)]
        parameter, value = model.parameters[k], float(model.theta[k])
        std_dev = float(_std_devs(model)[k])
        if std_dev < value:
            values[term.type] = value
            words.append(f"{term.type} {plain(value)} ± {plain(std_dev)} {parameter.unit}")
        else:
            words.append(f"{term.type} not determined, 0")
    coulomb, viscous = values.values()
    comment = f"{joint}: {', '.join(words) or 'no friction in the model'}"
    return JointFriction(coulomb, viscous, comment)


def _comments(model: Model, machine: Machine, source: str) -> list[str]:
    """Comments of a URDF: source of the model, and content that a URDF cannot hold."""
    lost = [
        term.type + ("" if term.only_joint is None else f" of {term.only_joint}")
        for term in model.terms
        if term.type not in FRICTION_TERMS and term.of_bodies(model.setting) is None
    ]
    still = [name for name in machine.joint_names if name not in model.joints]
    return [
        f"Model {model.name}: {model.provenance}".replace("--", "- -"),
        f"Not identified values are from {source}.",
        *(lost and [f"Left out, a URDF cannot hold it: {', '.join(lost)}."]),
        *(still and [f"No recording moved {', '.join(still)}; friction there is unknown."]),
        f"Gravity in base_link [m/s2]: {' '.join(map(plain, machine.gravity_vector))}.",
    ]


def export_mjcf(model: Model, prior: Path | str | None = None) -> str:
    """Return an identified model as MJCF, as MuJoCo converts it from `export_urdf`.

    Parameters
    ----------
    model, prior
        As `export_urdf` takes them.

    Returns
    -------
    Text of an MJCF with the gravity of the machine; the comments of the URDF stand at its top.

    Raises
    ------
    ConfigurationError, DataError
        As `identified_bodies`.
    ModuleNotFoundError
        MuJoCo is not installed.
    """
    import mujoco

    text = export_urdf(model, prior)
    assert model.machine is not None  # export_urdf refuses such a model
    spec = mujoco.MjSpec.from_string(text)
    spec.option.gravity = model.machine.gravity_vector
    spec.compile()
    comments = [line.strip() for line in text.splitlines() if line.strip().startswith("<!--")]
    return "\n".join([*comments, spec.to_xml()])


class ExportRequest(NamedTuple):
    """The command line of `export`."""

    model: Path
    prior: Path | None
    out: Path
    replace: bool


FORMATS = {".urdf": export_urdf, ".xml": export_mjcf}


def main(argv: Sequence[str] | None = None) -> int:
    """Write an identified model as URDF (.urdf) or MJCF (.xml)."""
    parser = cli.command_line(prog="export", description=main.__doc__)
    parser.add_argument("--model", type=Path, required=True, help="identified model file")
    parser.add_argument(
        "--prior",
        type=Path,
        help="prior file with bodies, for values that recordings do not determine (default: the "
        "links of the machine file as bars)",
    )
    parser.add_argument("--out", type=Path, required=True, help="new file, .urdf or .xml (MJCF)")
    cli.add_replace(parser)
    request = ExportRequest(**vars(parser.parse_args(argv)))

    def body() -> None:
        if request.out.suffix not in FORMATS:
            raise ConfigurationError(
                f"{request.out}: no format ends in '{request.out.suffix}'; name a file that ends "
                f"in {' or '.join(FORMATS)}"
            )
        cli.check_out(request.out, replace=request.replace)
        text = FORMATS[request.out.suffix](load_model(request.model), request.prior)
        request.out.write_text(text, encoding="utf-8")
        print(f"written: {request.out}; its comments mark what is not identified")

    return cli.run(body)
