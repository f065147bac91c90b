"""Physically consistent least squares: fitted under the constraints, never projected afterwards.

Every body is a variable of its own, by its planar pseudo-inertia (Wensing, Kim, Slotine 2018)

        | Σ   h |     Σ second moments (2, 2) [kg m²], h mass moments (2,) [kg m], m mass [kg],
    P = |       |     inertia tr Σ, all about the origin of the link
        | hᵀ  m |

which is positive definite exactly if some distribution of positive mass has these moments. Θ are
linear combinations of the bodies, so that the fit is a convex program with one solution for Θ,
though not for bodies of which the forces show only combinations.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from crane_identification.estimation.estimate import Estimate, Fit, describe
from crane_identification.estimation.least_squares import fit
from crane_identification.estimation.physics import BODIES, Inequality, Physics
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.rows import Rows, balancing, check
from crane_identification.options import Covariance
from crane_model.errors import DataError

SMALLEST = 0.01
"""Smallest eigenvalue of a pseudo-inertia [kg, m]: of what is lighter than this, or thinner, the
mass matrix could not be told from a singular one."""
HUNDREDS = 100.0  # kg
HEAVIEST = 1e5
"""Mass [kg] that no body reaches. That of the inner boom moves nothing and would have no limit."""
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
    `DataError` as `least_squares`.
    """
    check(rows)
    weights = balancing(rows)
    free = fit(rows, weights, covariance, prior)
    values, bounds = free.values, tuple[str, ...]()
    if physics.bodies is not None or physics.violated(free.values):
        values, bounds = _constrained(rows, weights, physics, free)
    known = " with a prior" if prior else ""
    method = f"physically consistent least squares{known}, {covariance} residual"
    return describe(rows, free._replace(values=values), method, bounds)


def _constrained(
    rows: Rows, weights: np.ndarray, physics: Physics, free: Fit
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Θ (p,) and the names of the constraints that hold it back."""
    # Distances from the free solution in standard deviations of the force; Θ in units in which each
    # parameter alone would make the whole force, bodies in hundreds of kilograms.
    scaling = np.broadcast_to(weights, rows.force.shape)[rows.used]
    matrix, force = rows.stacked * scaling[:, None], rows.force[rows.used] * scaling
    norms = np.linalg.norm(matrix, axis=0)
    units = np.linalg.norm(force) / np.where(norms > 0.0, norms, 1.0)
    residual = force - matrix @ free.values
    deviation = np.sqrt(residual @ residual / (len(residual) - matrix.shape[1]))
    deviation = max(float(deviation), np.finfo(float).tiny)
    if free.beforehand is not None:
        matrix = np.vstack([matrix, free.beforehand[0]])
        force = np.concatenate([force, free.beforehand[1]])
    q, triangle = np.linalg.qr(matrix * units / deviation)
    target = q.T @ force / deviation
    if physics.bodies is None and all(
        np.count_nonzero(x.weights) == 1 for x in physics.inequalities
    ):
        return _bounded(triangle, target, physics.inequalities, units)
    import cvxpy  # two seconds, for those who need them

    scaled = cvxpy.Variable(matrix.shape[1])
    constraints: dict[str, Any] = {
        one.name: share @ scaled >= one.least / size
        for one in physics.inequalities
        for size in [np.abs(one.weights * units).max()]
        for share in [one.weights * units / size]
    }
    if physics.bodies is not None:
        bodies = {name: cvxpy.Variable((3, 3), symmetric=True) for name in BODIES}
        standard = HUNDREDS * cvxpy.hstack(
            [
                quantity
                for P in bodies.values()
                for quantity in (P[2, 2], P[0, 2], P[1, 2], P[0, 0] + P[1, 1])
            ]
        )
        constraints |= {
            f"pseudo-inertia of {name}": P >> SMALLEST / HUNDREDS * np.eye(3)
            for name, P in bodies.items()
        }
        constraints |= {
            f"mass of {name}": P[2, 2] <= HEAVIEST / HUNDREDS for name, P in bodies.items()
        }
        base = units[physics.bodies.part]
        ours = cvxpy.multiply(base, scaled[physics.bodies.part])
        constraints["base"] = physics.bodies.base @ standard / HUNDREDS == ours / HUNDREDS
        constraints["axis"] = physics.bodies.none @ standard / HUNDREDS == 0.0
    distance = triangle @ scaled - target
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(distance)), list(constraints.values()))
    try:
        problem.solve(solver=cvxpy.CLARABEL)
    except cvxpy.error.SolverError as error:
        raise DataError(f"physically consistent fit: {error}; see by plain least squares") from None
    if problem.status not in (cvxpy.OPTIMAL, cvxpy.OPTIMAL_INACCURATE):
        raise DataError(
            f"physically consistent fit: the solver ends with '{problem.status}'; check the units "
            f"and signs of the recording, or see by plain least squares what is not physical"
        )
    values = np.asarray(scaled.value) * units
    if problem.value <= FELT**2:
        return values, ()
    held = tuple(
        name
        for name, constraint in constraints.items()
        if name not in ("base", "axis") and np.abs(constraint.dual_value).max() > FELT
    )
    for one in physics.inequalities:
        (which,) = np.nonzero(one.weights)
        if one.name in held and len(which) == 1:  # the solver rests near the bound, not on it
            values[which] = one.least / one.weights[which]
    return values, held


def _bounded(
    triangle: np.ndarray, target: np.ndarray, bounds: Sequence[Inequality], units: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """The same where single parameters alone are bounded, exactly, however alike columns are."""
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
