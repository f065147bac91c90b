"""Projection, search over sets and the null distribution, on columns made up for the purpose."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2
from unit.crane_identification.diagnosis import made

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.judgement import null_gains
from crane_identification.diagnosis.projection import (
    BEAM,
    NOTHING,
    Projection,
    Subset,
    extended,
    larger_sets,
    solve,
)
from crane_model.terms import REGISTRY

ROWS = 400
SHAPELESS = (
    *("actuator_inertia", "pressure_offset", "load_friction", "seal_friction", "pad_friction"),
    *("hose_stiffness", "coulomb", "viscous", "viscous_quadratic", "rotor_inertia", "offset"),
)


def best_first(made: Projection, beam: list[Subset]) -> list[Subset]:
    """The sets of one candidate more, best first."""
    return sorted(larger_sets(made, beam).values(), key=lambda one: -one.gain)[:BEAM]


def best_sets(made: Projection, largest: int) -> list[list[Subset]]:
    """The best sets of 1 to `largest` candidates."""
    beam, sizes = [NOTHING], []
    for _ in range(largest):
        beam = best_first(made, beam)
        sizes.append(beam)
    return sizes


def projection(
    columns: dict[str, np.ndarray], residual: np.ndarray, positive: bool = False
) -> Projection:
    """Each column as a candidate of its own: a candidate of that type on a joint `axis`."""
    unit = {name: values / np.linalg.norm(values) for name, values in columns.items()}
    candidates = tuple(
        ShapedCandidate(
            Candidate(REGISTRY[name], "axis"),
            {},
            REGISTRY["coulomb"].model_validate({"type": "coulomb", "joint": "axis"}),
            np.zeros((0, 1, 1)),
            np.array([positive]),
        )
        for name in columns
    )
    count = len(candidates)
    return Projection(
        candidates,
        np.stack(list(unit.values()), axis=1),
        residual,
        np.arange(count),
        np.full(count, positive),
        np.ones(count),
        np.ones(count),
    )


def names(found: Projection, numbers: tuple[int, ...]) -> set[str]:
    return {found.candidates[i].candidate.type for i in numbers}


def test_a_pair_is_found_behind_a_column_that_resembles_their_sum() -> None:
    """Where one effect at a time would begin with the wrong one."""
    rng = np.random.default_rng(1)
    a, b, noise = rng.standard_normal((3, ROWS))
    decoy = a + b + 0.7 * rng.standard_normal(ROWS)
    made = projection({"stribeck": a, "backlash": b, "hose_stiffness": decoy}, a + b + 0.05 * noise)
    single, pair = (size[0] for size in best_sets(made, 2))
    assert names(made, single.numbers) == {"hose_stiffness"}
    assert names(made, pair.numbers) == {"stribeck", "backlash"}


@pytest.mark.parametrize(("gain", "counts"), [(0.6, True), (-0.9, False)])
def test_no_scale_is_larger_than_a_transducer_of_another_range_makes(
    gain: float, counts: bool
) -> None:
    """Two columns that are nearly the same fit anything, with values of opposite signs."""
    rng = np.random.default_rng(3)
    force, small = rng.standard_normal((2, ROWS))
    alike = {"pressure_gain": force, "load_friction": force + 0.05 * small}
    made = projection(alike, force)
    made = replace(made, residual=gain * (made.columns[:, 0] - made.columns[:, 1]))
    pairs = best_sets(made, 2)[1]
    assert bool(pairs) is counts
    assert (solve(made, (0, 1)) is not None) is counts
    assert solve(made, (1,)) is not None


def test_gain_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(2)
    columns = rng.standard_normal((3, ROWS))
    residual = rng.standard_normal(ROWS)
    made = projection(dict(zip(("stribeck", "backlash", "offset"), columns, strict=True)), residual)
    solved = solve(made, (0, 2))
    assert solved is not None
    left = np.linalg.lstsq(columns[[0, 2]].T, residual, rcond=None)[1][0]
    assert solved.gain == pytest.approx(residual @ residual - left)


def test_a_parameter_of_the_wrong_sign_does_not_count() -> None:
    rng = np.random.default_rng(3)
    column = rng.standard_normal(ROWS)
    made = projection({"stribeck": column}, -column, positive=True)
    assert not larger_sets(made, [NOTHING])
    assert solve(made, (0,)) is None


@pytest.mark.parametrize("positive", [False, True])
def test_one_column_gains_chi_squared_from_noise(positive: bool) -> None:
    """With a sign constraint half of the time nothing."""
    rng = np.random.default_rng(4)
    made = projection({"stribeck": rng.standard_normal(ROWS)}, np.zeros(ROWS), positive)
    gains = null_gains(made, [], replicates=20000)
    tail = 0.05 * (0.5 if positive else 1.0)
    assert (gains > chi2(1).ppf(0.95)).mean() == pytest.approx(tail, abs=0.006)


@pytest.mark.parametrize("positive", [False, True])
def test_two_columns_that_are_alike_gain_chi_squared_of_two(positive: bool) -> None:
    """Not the sum of what each gains by itself, which is nearly the same twice; with signs less."""
    column, other = np.random.default_rng(7).standard_normal((2, made.ROWS))
    alike = np.stack([column, column + 0.1 * other], axis=1)
    signed = ("seal_friction",) if positive else ()
    found = made.searched({"seal_friction": alike}, np.zeros(made.ROWS), positive=signed)
    gains = null_gains(found.projection, [], replicates=20000)
    share = (gains > chi2(2).ppf(0.95)).mean()
    assert share < 0.03 if positive else share == pytest.approx(0.05, abs=0.006)


def test_noise_beside_a_chosen_column_gains_nothing_along_it() -> None:
    column = np.random.default_rng(5).standard_normal(ROWS)
    made = projection({"stribeck": column, "backlash": column}, np.zeros(ROWS))
    assert null_gains(made, [0], replicates=50).max() == pytest.approx(0.0, abs=1e-6)


def test_the_same_candidate_is_not_chosen_twice() -> None:
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal((2, ROWS))
    made: Any = projection({"stribeck": a, "backlash": b}, a + b)
    twin = projection({"stribeck": a + 0.1 * b, "backlash": b}, a + b)
    both = Projection(
        made.candidates + twin.candidates[:1],
        np.concatenate([made.columns, twin.columns[:, :1]], axis=1),
        made.residual,
        np.arange(3),
        np.zeros(3, dtype=bool),
        np.ones(3),
        np.ones(3),
    )
    for size in best_sets(both, 2):
        for subset in size:
            candidates = [both.candidates[i].candidate for i in subset.numbers]
            assert len(set(candidates)) == len(candidates)


@pytest.mark.parametrize("seed", range(6))
def test_sets_that_are_solved_together_are_solved_as_one_by_one(seed: int) -> None:
    """Candidates of one to three columns, some alike, whose signs are free or bound."""
    rng = np.random.default_rng(seed)
    shared = rng.standard_normal(made.ROWS)
    columns = {
        kind: rng.standard_normal((made.ROWS, 1 + n % 3)) + (n % 2) * shared[:, np.newaxis]
        for n, kind in enumerate(SHAPELESS)
    }
    missing = sum(values @ rng.standard_normal(values.shape[1]) for values in columns.values())
    signed = rng.choice(list(columns), 6, replace=False).tolist()
    found = made.searched(columns, 0.1 * missing, positive=signed).projection
    for start in (NOTHING, *best_sets(found, 2)[1][:3]):
        grown = list(extended(found, start))
        assert grown
        for one in grown:
            alone = solve(found, one.numbers)
            assert alone is not None and one.gain == alone.gain
            np.testing.assert_array_equal(one.values, alone.values)
            inside = np.concatenate([found.columns_of[i] for i in one.numbers])
            if one.values.all():  # no sign was wrong
                free = np.linalg.lstsq(found.columns[:, inside], found.residual, rcond=None)[0]
                np.testing.assert_allclose(one.values, free, rtol=1e-6, atol=1e-6)
