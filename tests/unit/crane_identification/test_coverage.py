"""A small version of tests/benchmarks/test_estimators_coverage.py, for every day."""

import numpy as np
from unit.crane_identification.experiments import experiment
from unit.crane_identification.synthetic import crane_model

from crane_identification import fit

EXPERIMENTS = 12
SPREAD = 0.07  # of the share of 20 parameters that one experiment covers, standard deviation


def test_intervals_cover_what_they_claim() -> None:
    """Pooled over parameters, within three standard errors of 95 %."""
    covered = []
    for seed in range(5000, 5000 + EXPERIMENTS):
        estimate = fit(crane_model(), [experiment(seed)]).estimate
        errors = (estimate.values - crane_model().theta) / estimate.std_devs
        covered.append(np.mean(np.abs(errors) < 1.96))
    assert abs(np.mean(covered) - 0.95) < 3 * SPREAD / np.sqrt(EXPERIMENTS)
