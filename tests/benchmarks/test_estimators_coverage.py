"""Do 95 % intervals hold the true value in 95 % of experiments? A thousand of them."""

import multiprocessing
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import binomtest
from unit.crane_identification.experiments import experiment
from unit.crane_identification.synthetic import crane_model

from crane_identification import Estimator, Options, fit

EXPERIMENTS = 1000
PERIODS = 3
CONFIDENCE = 1.959964  # standard deviations either side of a 95 % interval


class Outcome(NamedTuple):
    """Errors in standard deviations (20,), and p-values of the test of lack of fit (3,)."""

    errors: np.ndarray
    p_values: np.ndarray


def outcome(seed: int, estimator: Estimator = Estimator.CONSISTENT) -> Outcome:
    """One experiment through the whole preparation."""
    found = fit(crane_model(), [experiment(seed, PERIODS)], Options(estimator=estimator))
    errors = (found.estimate.values - crane_model().theta) / found.estimate.std_devs
    return Outcome(errors, found.lack_of_fit.p_value)


@pytest.fixture(scope="module")
def outcomes() -> Outcome:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = pool.map(outcome, range(EXPERIMENTS), chunksize=10)
    return Outcome(*(np.stack(part) for part in zip(*found, strict=True)))


def test_intervals_cover_what_they_claim(outcomes: Outcome, measured) -> None:
    covered = np.abs(outcomes.errors) < CONFIDENCE
    print(f"\ncoverage of 95 % intervals in {EXPERIMENTS} experiments (95 % binomial interval)")
    for parameter, column in zip(crane_model().parameters, covered.T, strict=True):
        low, high = binomtest(int(column.sum()), EXPERIMENTS).proportion_ci()
        print(f"  {parameter.name:18s} {column.mean():6.1%}  ({low:.1%} to {high:.1%})")
    pooled, spread = covered.mean(), covered.mean(axis=1).std() / np.sqrt(EXPERIMENTS)
    print(f"  pooled             {pooled:6.1%}  (standard error {spread:.2%})")
    single = covered.mean(axis=0)
    measured(
        f"95 % intervals that cover the true value, {EXPERIMENTS} experiments, pooled",
        "93 to 97 %",
        "{pooled:.1%} ± {spread:.2%}; single parameters {lowest:.1%} to {highest:.1%}",
        pooled=pooled,
        spread=spread,
        lowest=single.min(),
        highest=single.max(),
    )
    assert 0.93 < pooled < 0.97


def test_lack_of_fit_is_found_as_often_as_it_claims(outcomes: Outcome, measured) -> None:
    """Nothing is missing in the model: p-values are uniform."""
    print("\nlack of fit wrongly found at p < 5 %, p < 50 %")
    for joint, p_values in zip(crane_model().joints, outcomes.p_values.T, strict=True):
        rare, half = (p_values < 0.05).mean(), (p_values < 0.5).mean()
        print(f"  {joint:12s} {rare:5.1%} {half:5.1%}")
        measured(
            f"lack of fit of {joint} wrongly found in these at p < 5 %; at p < 50 %",
            "5 %; 50 %",
            "{rare:.1%}; {half:.0%}",
            rare=rare,
            half=half,
        )
        assert 0.02 < rare < 0.10
        assert 0.4 < half < 0.6
