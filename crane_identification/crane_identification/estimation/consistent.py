"""Physically consistent least squares: fitted under the constraints, never projected afterwards.

Every body is a variable of its own, by its pseudo-inertia (Wensing, Kim, Slotine 2018): in space

        | Σ   h |     Σ second moments (3, 3) [kg m²], h mass moments (3,) [kg m], m mass [kg],
    P = |       |     inertia tr Σ 1 - Σ, all about the origin of the link,
        | hᵀ  m |

and in the plane the same with two directions and the inertia tr Σ. It is positive definite exactly
if some distribution of positive mass has these moments. Θ are linear combinations of the bodies, so
that the fit is a convex program with one solution for Θ, though not for bodies of which the forces
show only combinations.

With a prior by the log-det divergence (Lee, Wensing, Park 2019), the bodies are unique as well:
d(P, P0) = -log det P + log det P0 + tr(P0⁻¹ P) - 4 keeps P positive definite, and is the same in
any frame and unit.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.estimation.least_squares import fit
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.regression import (
    Estimate,
    Fit,
    Rows,
    balancing,
    check,
    describe,
)
from crane_identification.options import Covariance
from crane_model.base_parameters import STANDARD_PARAMETERS, lagrangian_from_standard
from crane_model.chain.body_regressor import PER_BODY, TEN_FROM_PSEUDO_INERTIA
from crane_model.dynamics import Geometry
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term
from crane_model.terms.drives import RotorInertia

BODIES = ("inner boom", "outer boom", "telescope and gripper")
ROTOR_STATES = 100  # random ones that show whether a rotor is told from bodies
ROTOR_TOLERANCE = 1e-6  # share of a column's norm
LEAST_EIGENVALUE_IN_PLANE = 0.01
"""Smallest eigenvalue of a planar pseudo-inertia [kg, m]: of what is lighter than this, or thinner,
the mass matrix could not be told from a singular one."""
PLANAR_MASS_UNIT_KG = 100.0  # kg, the unit of masses of planar bodies
LEAST_EIGENVALUE_IN_SPACE = 1e-6
"""The same in space, in parts of the mass with which equal bodies would make the measured force,
and of the mean length of a link: a hundred times what the solver rounds."""
LARGEST_MASS = 1000.0
"""Mass that no body reaches, in these units. That of an inner boom moves nothing and would have no
limit."""
LEAST_RESIDUAL_SHARE = 1e-6
"""Share of the force that a residual of simulated data, without noise, counts as having: from less,
the solver would be asked for digits that it does not have."""
FELT_SIGMAS = 0.01
"""Standard deviations of the force by which a constraint must hold Θ back to be named."""


@dataclass(frozen=True)
class Inequality:
    """`weights` · Θ >= `least`, in words `name`."""

    name: str
    weights: np.ndarray  # (p,)
    least: float


@dataclass(frozen=True)
class Bodies:
    """The k bodies behind the base parameters Θ[`part`], each by its pseudo-inertia P (d, d).

    A body has s standard parameters, `moments` (s, d, d) : P. `base` (r, k s) @ those of all bodies
    gives Θ[`part`], for any bodies for which `none` (c, k s) @ standard parameters is 0. To these
    `rotors` (r, l) adds, times an inertia of at least 0 each, those of drives that the machine has
    and the model lacks, if forces cannot tell them from bodies. A body of 1 kg has P about the
    square of `size` (d,), on its diagonal. P is positive definite where `definite` (k,), elsewhere
    at least not negative.
    """

    part: slice
    names: tuple[str, ...]
    moments: np.ndarray
    base: np.ndarray
    none: np.ndarray
    rotors: np.ndarray
    size: np.ndarray
    definite: np.ndarray

    @property
    def in_space(self) -> bool:
        """Return whether bodies have all ten parameters; else they are planar."""
        return self.moments.shape[1] == 4


@dataclass(frozen=True)
class Physics:
    """All that physics asks of Θ (p,)."""

    inequalities: tuple[Inequality, ...]
    bodies: Bodies | None

    def violated(self, values: np.ndarray) -> list[str]:
        """Names of the inequalities that `values` (p,) do not keep."""
        return [
            inequality.name
            for inequality in self.inequalities
            if inequality.weights @ values < inequality.least
        ]


def physics(model: Model, bodies_in_space: bool = True) -> Physics:
    """Minimum of every parameter, friction (13) that brakes in both directions, and the bodies.

    Without `bodies_in_space`, of bodies only those of a planar crane.
    """
    names = [parameter.name for parameter in model.parameters]
    unit, bodies = np.eye(len(names)), _bodies(model, bodies_in_space)
    # Minima of a body in space follow from its pseudo-inertia.
    implied = range(len(names))[bodies.part] if bodies and bodies.in_space else range(0)
    inequalities = [
        Inequality(f"{parameter.name} >= {parameter.minimum:g}", unit[i], parameter.minimum)
        for i, parameter in enumerate(model.parameters)
        if parameter.minimum is not None and i not in implied
    ]
    for mean, half in _asymmetries(model):
        inequalities += [
            Inequality(f"{names[mean]} + {names[half]} >= 0", unit[mean] + unit[half], 0.0),
            Inequality(f"{names[mean]} - {names[half]} >= 0", unit[mean] - unit[half], 0.0),
        ]
    return Physics(tuple(inequalities), bodies)


def _asymmetries(model: Model) -> list[tuple[int, int]]:
    """Columns in Θ of the mean of both directions and of half their difference, by joint."""
    means = {(term.type, term.only_joint): model.part(term).start for term in model.terms}
    pairs = [
        (term.type, model.joints.index(term.only_joint), mean, model.part(term).start)
        for term in model.terms
        if term.asymmetry_of is not None
        and term.only_joint is not None
        and (mean := means.get((term.asymmetry_of, term.only_joint))) is not None
    ]
    return [(mean, half) for *_, mean, half in sorted(pairs)]


def _bodies(model: Model, in_space: bool) -> Bodies | None:
    if model.base_parameters is not None:
        return _in_the_plane(model, model.base_parameters)
    for term in model.terms if in_space else ():
        base = term.of_bodies(model.setting)
        if base is not None:
            return _in_space(model, term, base)
    return None


def _in_the_plane(model: Model, part: slice) -> Bodies:
    assert model.machine is not None  # the term of the base parameters refuses such a model
    geometry = Geometry.of(model.machine)
    lagrangian = lagrangian_from_standard(geometry)
    mass = STANDARD_PARAMETERS.index("m_TG")
    none = lagrangian[8:] - geometry.telescope_offset * np.eye(12)[[mass]]
    moments = np.zeros((4, 3, 3))
    moments[0, 2, 2] = moments[1, 0, 2] = moments[2, 1, 2] = 1.0
    moments[3, [0, 1], [0, 1]] = 1.0
    no_rotors, exist = np.zeros((8, 0)), np.ones(3, dtype=bool)
    return Bodies(part, BODIES, moments, lagrangian[:8], none, no_rotors, np.ones(3), exist)


def _in_space(model: Model, term: Term, base: np.ndarray) -> Bodies:
    machine = model.machine
    assert machine is not None  # a term of bodies refuses such a model
    names = tuple(joint.name for joint in machine.joints)
    chain = machine.chain
    links = np.linalg.norm([*chain.translation[1:], chain.tip_translation], axis=1)
    length = float(links.mean()) or 1.0
    ten = [f"{quantity}.{name}" for name in names for quantity in PER_BODY]
    zero = [ten.index(name) for name in term.zero_moments]
    # A body without mass, or without inertia about an axis, is at the edge of what there can be.
    definite = np.ones(len(names), dtype=bool)
    definite[[i // 10 for i in zero if PER_BODY[i % 10] in ("m", "Ixx", "Iyy", "Izz")]] = False
    return Bodies(
        model.part(term),
        names,
        TEN_FROM_PSEUDO_INERTIA,
        base,
        np.eye(len(ten))[zero],
        _hidden_rotors(model, term, machine),
        np.array([length, length, length, 1.0]),
        definite,
    )


def _hidden_rotors(model: Model, term: Term, machine: Machine) -> np.ndarray:
    """(r, l) parameters of the bodies of `term` that a rotor of 1 kg m² is taken for."""
    lacking = [
        joint
        for joint in machine.rotors
        if joint in model.joints and RotorInertia(joint=joint) not in model.terms
    ]
    motion = np.random.default_rng(0).standard_normal((3, ROTOR_STATES, len(model.joints)))
    record = Record(model.joints, np.arange(float(ROTOR_STATES)), *motion)
    columns = term.columns(record, model.setting)
    taken = np.zeros((columns.shape[2], 0))
    for joint in lacking:
        try:
            rotor = RotorInertia(joint=joint).columns(record, model.setting)
        except ConfigurationError:  # it also turns with joints that the model lacks
            continue
        alike = np.linalg.lstsq(columns.reshape(-1, columns.shape[2]), rotor.ravel(), rcond=None)[0]
        if np.linalg.norm(columns @ alike - rotor[:, :, 0]) < ROTOR_TOLERANCE * np.linalg.norm(
            rotor
        ):
            taken = np.column_stack([taken, alike])
    return taken


def consistent(
    rows: Rows,
    physics: Physics,
    covariance: Covariance = Covariance.CORRELATED,
    prior: Prior | None = None,
) -> Estimate:
    """Θ that minimises the norm of τ - ΦΘ (30) among physical ones, weighted as `least_squares`.

    Where least squares is physical, it is the solution. Standard deviations are those of least
    squares, which constraints can only lower; `bounds` names the constraints that hold Θ back.
    Those of a prior by the log-det divergence are of the Gaussian with its curvature at the known
    bodies. `DataError` as `least_squares`.
    """
    check(rows)
    weights = balancing(rows)
    free = fit(rows, weights, covariance, prior)
    values, bounds = free.values, tuple[str, ...]()
    if physics.bodies is not None or physics.violated(free.values):
        values, bounds = _constrained(rows, weights, physics, free, prior)
    known = f" with a {prior.wording}" if prior else ""
    method = f"physically consistent least squares{known}, {covariance} residual"
    return describe(rows, free._replace(values=values), method, bounds)


class _Squares(NamedTuple):
    """The sum of squares |`triangle` x - `target`|² of Θ = x * `units`, in variances of the force.

    `force` is the norm of what was measured, and `excess` how much more than one a row of the prior
    counts, both in these standard deviations.
    """

    triangle: np.ndarray  # (p, p)
    target: np.ndarray  # (p,)
    units: np.ndarray  # (p,)
    force: float
    excess: float


def _constrained(
    rows: Rows, weights: np.ndarray, physics: Physics, free: Fit, prior: Prior | None
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Θ (p,) and the names of the constraints that hold it back."""
    squares = _squares(rows, weights, free, prior)
    if physics.bodies is None and all(
        np.count_nonzero(x.weights) == 1 for x in physics.inequalities
    ):
        return _bounded(squares, physics.inequalities)
    import cvxpy  # two seconds, for those who need them

    units, constraints = squares.units, dict[str, Any]()
    scaled: Any = cvxpy.Variable(len(units))
    divergence, variables = 0.0, list[tuple[Any, float]]()
    if physics.bodies is not None:
        part = physics.bodies.part
        ours, divergence, variables = _of_bodies(physics.bodies, squares, prior, constraints)
        scaled = cvxpy.hstack([scaled[: part.start], ours, scaled[part.stop :]])
    for inequality in physics.inequalities:
        share = inequality.weights * units
        size = np.abs(share).max()
        constraints[inequality.name] = share / size @ scaled >= inequality.least / size
    distance = squares.triangle @ scaled - squares.target
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.sum_squares(distance) + divergence), list(constraints.values())
    )
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Solution may be inaccurate")  # see below
            problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.error.SolverError as error:
        raise DataError(f"physically consistent fit: {error}; see by plain least squares") from None
    if problem.status not in (cvxpy.OPTIMAL, cvxpy.OPTIMAL_INACCURATE):
        raise DataError(
            f"physically consistent fit: the solver ends with '{problem.status}'; check the units "
            f"and signs of the recording, or see by plain least squares what is not physical"
        )
    for X, least in variables:  # whatever the solver rounds, the bodies can exist
        short = max(least - float(np.linalg.eigvalsh(X.value)[0]), 0.0)
        X.value = X.value + short * np.eye(len(X.value))
    values = np.asarray(scaled.value) * units
    if float(np.sum(distance.value**2)) <= FELT_SIGMAS**2:
        return values, ()
    held = tuple(
        name
        for name, constraint in constraints.items()
        if name != "axis" and np.abs(constraint.dual_value).max() > FELT_SIGMAS
    )
    for inequality in physics.inequalities:
        (which,) = np.nonzero(inequality.weights)
        # the solver rests near the bound, not on it
        if inequality.name in held and len(which) == 1:
            values[which] = inequality.least / inequality.weights[which]
    return values, held


def _squares(rows: Rows, weights: np.ndarray, free: Fit, prior: Prior | None) -> _Squares:
    # Distances from the free solution in standard deviations of the force; Θ in units in which each
    # parameter alone would make the whole force.
    scaling = np.broadcast_to(weights, rows.force.shape)[rows.used]
    matrix, force = rows.stacked * scaling[:, None], rows.force[rows.used] * scaling
    norms, size = np.linalg.norm(matrix, axis=0), float(np.linalg.norm(force))
    units = size / np.where(norms > 0.0, norms, 1.0)
    residual = force - matrix @ free.values
    deviation = np.sqrt(residual @ residual / (len(residual) - matrix.shape[1]))
    deviation = max(
        float(deviation), LEAST_RESIDUAL_SHARE * size / np.sqrt(len(force)), np.finfo(float).tiny
    )
    excess = 1.0
    if free.beforehand is not None and prior is not None:
        excess = float(np.linalg.norm(free.beforehand[0]) / np.linalg.norm(prior.matrix)) ** 2
        # The divergence takes the place of the rows of the bodies, which stand last.
        gaussian = len(prior.matrix) - (0 if prior.bodies is None else prior.bodies.rows)
        matrix = np.vstack([matrix, free.beforehand[0][:gaussian]])
        force = np.concatenate([force, free.beforehand[1][:gaussian]])
    q, triangle = np.linalg.qr(matrix * units / deviation)
    target = q.T @ force / deviation
    return _Squares(triangle, target, units, size / deviation, excess / deviation**2)


def _of_bodies(
    bodies: Bodies, squares: _Squares, prior: Prior | None, constraints: dict[str, Any]
) -> tuple[Any, Any, list[tuple[Any, float]]]:
    """Θ / units of the bodies as an expression (r,), and the divergence from those that are known.

    What the bodies must obey joins the `constraints`. Behind them stand the variables that may be
    enlarged alone, with their smallest eigenvalues.
    """
    import cvxpy

    units = squares.units[bodies.part]
    equal = np.concatenate(
        [np.einsum("sij,ij->s", bodies.moments, np.diag(bodies.size**2)) for _ in bodies.names]
    )
    mass, smallest = PLANAR_MASS_UNIT_KG, LEAST_EIGENVALUE_IN_PLANE / PLANAR_MASS_UNIT_KG
    if bodies.in_space:
        smallest = LEAST_EIGENVALUE_IN_SPACE
        made = squares.triangle[:, bodies.part] @ (bodies.base @ equal / units)
        mass = squares.force / max(float(np.linalg.norm(made)), np.finfo(float).tiny)
    known = None if prior is None else prior.bodies
    standard, divergence, variables = [], 0.0, []
    for i, name in enumerate(bodies.names):
        # P = K X Kᵀ, with X of the size 1.
        factor = np.sqrt(mass) * np.diag(bodies.size)
        if known is not None:
            factor = np.linalg.cholesky(known.pseudo_inertia[i])
        X = cvxpy.Variable((len(factor), len(factor)), symmetric=True)
        moments = np.array([factor.T @ moment @ factor for moment in bodies.moments])
        least = smallest * bodies.definite[i]
        if bodies.in_space and bodies.definite[i]:
            variables.append((X, least))
        standard.append(moments.reshape(len(moments), -1) @ cvxpy.vec(X, order="C"))
        if known is not None:
            weight = 2.0 * squares.excess / known.relative_std_dev[i] ** 2
            divergence += weight * (cvxpy.trace(X) - cvxpy.log_det(X) - len(factor))
            continue
        constraints[f"pseudo-inertia of {name}"] = X >> least * np.eye(len(factor))
        constraints[f"mass of {name}"] = X[-1, -1] <= LARGEST_MASS
    all_of_them = cvxpy.hstack(standard)
    size = mass * float(np.abs(equal).max())
    if len(bodies.none):
        constraints["axis"] = bodies.none / size @ all_of_them == 0.0
    ours = (bodies.base / units[:, None]) @ all_of_them
    if known is None and bodies.rotors.shape[1]:  # known bodies tell rotors from links
        rotors = bodies.rotors / units[:, None]
        ours = ours + rotors / np.linalg.norm(rotors, axis=0) @ cvxpy.Variable(
            rotors.shape[1], nonneg=True
        )
    return ours, divergence, variables


def _bounded(squares: _Squares, bounds: Sequence[Inequality]) -> tuple[np.ndarray, tuple[str, ...]]:
    """The same where single parameters alone are bounded, exactly, however alike columns are."""
    triangle, target, units, *_ = squares
    least, most = np.full((2, len(units)), [[-np.inf], [np.inf]])
    names: dict[tuple[int, int], str] = {}
    for bound in bounds:
        (k,) = np.flatnonzero(bound.weights)
        limit, side = bound.least / bound.weights[k] / units[k], -int(np.sign(bound.weights[k]))
        if side < 0:
            least[k] = max(least[k], limit)
        else:
            most[k] = min(most[k], limit)
        names[int(k), side] = bound.name
    found = lsq_linear(triangle, target, (least, most), method="bvls")
    rest = triangle @ found.x - target
    if rest @ rest <= FELT_SIGMAS**2:
        return found.x * units, ()
    pressing = np.abs(2.0 * triangle.T @ rest) > FELT_SIGMAS
    held = [
        names[int(k), int(found.active_mask[k])]
        for k in np.flatnonzero(found.active_mask * pressing)
    ]
    return found.x * units, tuple(held)
