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
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.estimation.estimate import Estimate, Fit, describe
from crane_identification.estimation.least_squares import fit
from crane_identification.estimation.physics import Bodies, Inequality, Physics
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.regression import Rows, balancing, check
from crane_identification.options import Covariance
from crane_model.errors import DataError

SMALLEST = 0.01
"""Smallest eigenvalue of a planar pseudo-inertia [kg, m]: of what is lighter than this, or thinner,
the mass matrix could not be told from a singular one."""
HUNDREDS = 100.0  # kg, the unit of masses of planar bodies
SMALLEST_IN_SPACE = 1e-6
"""The same in space, in parts of the mass with which equal bodies would make the measured force,
and of the mean length of a link: a hundred times what the solver rounds."""
HEAVIEST = 1000.0
"""Mass that no body reaches, in these units. That of an inner boom moves nothing and would have no
limit."""
CLEAN = 1e-6
"""Share of the force that a residual of simulated data, without noise, counts as having: from less,
the solver would be asked for digits that it does not have."""
FELT = 0.01
"""Standard deviations of the force by which a constraint must hold Θ back to be named."""


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
    for one in physics.inequalities:
        share = one.weights * units
        size = np.abs(share).max()
        constraints[one.name] = share / size @ scaled >= one.least / size
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
    if float(np.sum(distance.value**2)) <= FELT**2:
        return values, ()
    held = tuple(
        name
        for name, constraint in constraints.items()
        if name != "axis" and np.abs(constraint.dual_value).max() > FELT
    )
    for one in physics.inequalities:
        (which,) = np.nonzero(one.weights)
        if one.name in held and len(which) == 1:  # the solver rests near the bound, not on it
            values[which] = one.least / one.weights[which]
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
    deviation = max(float(deviation), CLEAN * size / np.sqrt(len(force)), np.finfo(float).tiny)
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
    mass, smallest = HUNDREDS, SMALLEST / HUNDREDS
    if bodies.in_space:
        smallest = SMALLEST_IN_SPACE
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
        moments = np.array([factor.T @ each @ factor for each in bodies.moments])
        least = smallest * bodies.definite[i]
        if bodies.in_space and bodies.definite[i]:
            variables.append((X, least))
        standard.append(moments.reshape(len(moments), -1) @ cvxpy.vec(X, order="C"))
        if known is not None:
            weight = 2.0 * squares.excess / known.relative_std_dev[i] ** 2
            divergence += weight * (cvxpy.trace(X) - cvxpy.log_det(X) - len(factor))
            continue
        constraints[f"pseudo-inertia of {name}"] = X >> least * np.eye(len(factor))
        constraints[f"mass of {name}"] = X[-1, -1] <= HEAVIEST
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
    for one in bounds:
        (k,) = np.flatnonzero(one.weights)
        limit, side = one.least / one.weights[k] / units[k], -int(np.sign(one.weights[k]))
        if side < 0:
            least[k] = max(least[k], limit)
        else:
            most[k] = min(most[k], limit)
        names[int(k), side] = one.name
    found = lsq_linear(triangle, target, (least, most), method="bvls")
    rest = triangle @ found.x - target
    if rest @ rest <= FELT**2:
        return found.x * units, ()
    pressing = np.abs(2.0 * triangle.T @ rest) > FELT
    held = [
        names[int(k), int(found.active_mask[k])]
        for k in np.flatnonzero(found.active_mask * pressing)
    ]
    return found.x * units, tuple(held)
