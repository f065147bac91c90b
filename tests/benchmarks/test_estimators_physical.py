"""Physically consistent beside plain least squares: mass matrix in 10,000 poses, held-out error."""

import numpy as np
import pytest
from unit.crane_identification.experiments import experiment
from unit.crane_identification.synthetic import crane_model
from unit.crane_identification.test_consistent import bodies_exist, scarce, smallest_eigenvalue

from crane_identification import Estimate, Estimator, Options, fit, validate
from crane_identification.estimation.consistent import consistent, physics
from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.regression import build_rows

POSES = 10_000
FITS = 25
NOISES = (0.0, 10.0, 30.0, 100.0)  # N m and N, added to the rows of scarce data


@pytest.mark.parametrize("noise", NOISES)
def test_physical_and_hardly_worse(noise: float, measured) -> None:
    plain_fit = fit(crane_model(), [experiment(1)], Options(estimator=Estimator.LEAST_SQUARES))
    (held_out,) = validate(
        plain_fit.model, [experiment(2, trajectory="validation_20s.yaml")], Options()
    )
    seen = build_rows(crane_model(), held_out.preparation, plain_fit.decimation)
    size = seen.rms(seen.force)

    def error(estimate: Estimate) -> float:
        return float(np.linalg.norm(seen.rms(seen.residual(estimate.values)) / size))

    ratios, indefinite, poses, impossible = [], [], [], 0
    for seed in range(FITS if noise else 1):
        rows = scarce(plain_fit.rows, seed, noise) if noise else plain_fit.rows
        plain, physical = least_squares(rows), consistent(rows, physics(crane_model()))
        ratios.append(error(physical) / error(plain))
        indefinite.append((smallest_eigenvalue(plain.values, POSES) <= 0.0).mean())
        poses.append((smallest_eigenvalue(physical.values, POSES) > 0.0).sum())
        impossible += not bodies_exist(plain.values)
    data = f"half of the rows, noise {noise:g}" if noise else "all rows"
    print(
        f"\n{data}: {len(ratios)} fits; "
        f"least squares: {impossible} machines that cannot exist, M indefinite in up to "
        f"{max(indefinite):.0%} of poses; physically consistent: M positive definite in at least "
        f"{min(poses)} of {POSES} poses, held-out error {np.mean(ratios):.3f} (worst "
        f"{max(ratios):.3f}) times that of least squares"
    )
    measured(
        f"physically consistent fit, {data}: M positive definite; held-out error / least squares",
        f"{POSES} of {POSES} poses; 1.02",
        "{positive:.0f}; {error:.3f}",
        positive=min(poses),
        error=np.mean(ratios),
    )
    assert min(poses) == POSES
    assert np.mean(ratios) < 1.02
