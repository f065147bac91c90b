"""A model is fitted beside nuisances, and shapes have deviations, with known answers."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import (
    MASS,
    MODEL,
    ROWS,
    evidence,
    normal,
    search,
    shaped,
)

from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.candidates import at_shape as observed
from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.fit import UndeterminedError, refit, refit_anyway
from crane_identification.diagnosis.projection import solve
from crane_identification.diagnosis.proof import shape_std_devs
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_model import Model, Record
from crane_model.terms import REGISTRY
from crane_model.terms.friction import Stribeck, Viscous

ACCELERATION, NOISE = normal(1), 0.5
SPEED, EXPONENT, FRICTION = 0.0335, 1.0, 8.0  # of the Stribeck curve, between points of the grid


def test_values_and_deviations_are_those_of_least_squares() -> None:
    given = evidence(MASS * ACCELERATION + NOISE * normal(2), ACCELERATION[:, np.newaxis])
    found = refit(given, "made")
    std_dev = NOISE / np.linalg.norm(ACCELERATION)
    assert found.std_devs is not None and found.provenance is not None
    assert found.theta[0] == pytest.approx(MASS, abs=3.0 * std_dev)
    assert found.std_devs[0] == pytest.approx(std_dev, rel=0.15)
    assert f"{ROWS} rows of made" in found.provenance


def test_a_nuisance_beside_the_model_moves_no_value() -> None:
    """It resembles the acceleration, and its coefficient is its own."""
    nuisance = 0.6 * ACCELERATION + 0.8 * normal(3)
    force = MASS * ACCELERATION + 40.0 * nuisance + NOISE * normal(2)
    alone = refit(evidence(force, ACCELERATION[:, np.newaxis]), "made")
    beside = refit(evidence(force, np.stack([ACCELERATION, nuisance], axis=1)), "made")
    assert beside.theta[0] == pytest.approx(MASS, abs=0.1)
    taken = nuisance @ ACCELERATION / (ACCELERATION @ ACCELERATION)
    assert alone.theta[0] == pytest.approx(MASS + 40.0 * taken, abs=0.1)
    assert beside.std_devs is not None
    known = ACCELERATION - nuisance * (nuisance @ ACCELERATION) / (nuisance @ nuisance)
    assert beside.std_devs[0] == pytest.approx(NOISE / np.linalg.norm(known), rel=0.15)


def test_what_recordings_do_not_determine_is_named() -> None:
    two = Model("axis", MODEL.setting, (*MODEL.terms, Viscous(joint="axis")))
    base = np.stack([ACCELERATION, 2.0 * ACCELERATION], axis=1)
    given = replace(evidence(MASS * ACCELERATION + NOISE * normal(2), base), model=two)
    with pytest.raises(UndeterminedError, match="show only combinations") as error:
        refit(given, "made")
    assert set(error.value.names) == {p.name for p in two.parameters}


def test_what_the_model_lacks_does_not_hide_its_parameters() -> None:
    """Columns that differ by a thirtieth, beside ten times their force that is not in the model."""
    two = Model("axis", MODEL.setting, (*MODEL.terms, Viscous(joint="axis")))
    base = np.stack([ACCELERATION, ACCELERATION + 0.03 * normal(3)], axis=1)
    given = replace(evidence(base @ [MASS, 2.0] + 70.0 * normal(4), base), model=two)
    found = refit(given, "made")
    assert found.std_devs is not None
    assert (np.abs(found.theta - [MASS, 2.0]) < 4.0 * found.std_devs).all()


def test_of_combinations_what_is_determined_is_kept() -> None:
    two = Model("axis", MODEL.setting, (*MODEL.terms, Viscous(joint="axis")))
    base = np.stack([ACCELERATION, 2.0 * ACCELERATION], axis=1)
    given = replace(evidence(MASS * ACCELERATION + NOISE * normal(2), base), model=two)
    found, held = refit_anyway(given, "made")
    assert held == tuple(p.name for p in two.parameters)
    assert found.std_devs is not None
    assert found.theta @ [1.0, 2.0] == pytest.approx(MASS, abs=0.1)
    assert (found.std_devs > 0.5 * np.abs(found.theta)).all(), "and how it is shared out is unknown"


def test_rows_that_their_unknowns_explain_do_not_outweigh_all_others() -> None:
    """Nine rows close to reversals, of eight nuisances beside the mass, say nothing."""
    near = np.arange(ROWS) < 9
    given = evidence(MASS * ACCELERATION + NOISE * normal(2), normal(5, ROWS, 9))
    base, force, used = given.base.copy(), given.force.copy(), given.used.copy()
    base[:, 0, 0], base[:, 0, 1:] = ACCELERATION, 0.0
    base[:, 1, 0], base[:, 1, 1:] = 30.0 * ACCELERATION, normal(5, ROWS, 8)
    force[:, 1], used[:, 1] = 20.0 * MASS * ACCELERATION, near
    found = refit(replace(given, base=base, force=force, used=used), "made")
    assert found.theta[0] == pytest.approx(MASS, abs=0.1)


@pytest.fixture(scope="module")
def seen() -> Evidence:
    """An axis that lacks a Stribeck curve, at all speeds."""
    velocity = 0.2 * np.sin(np.linspace(0.0, 60.0, ROWS))[:, np.newaxis]
    record = Record(
        joints=("axis",),
        time=0.1 * np.arange(ROWS),
        position=np.zeros((ROWS, 1)),
        velocity=velocity,
        acceleration=ACCELERATION[:, np.newaxis],
    )
    run = Run("bag", 0, record, np.repeat([[1.0, 0.0]], ROWS, axis=0), 1)
    curve = Stribeck(joint="axis", speed=SPEED, exponent=EXPONENT)
    law = FRICTION * curve.columns(record, MODEL.setting)[:, 0, 0]
    force = MASS * ACCELERATION + law + NOISE * normal(2)
    return evidence(force, ACCELERATION[:, np.newaxis], runs=(run,))


def curve(seen: Evidence, speed: float, exponent: float = EXPONENT) -> Search:
    """The Stribeck curve with one shape as the only candidate."""
    candidate = Candidate(REGISTRY["stribeck"], "axis")
    return search(seen, [observed(seen, candidate, {"speed": speed, "exponent": exponent})])


def test_shapes_have_the_deviations_of_the_joint_fit(seen: Evidence) -> None:
    """By the derivative of the curve, beside its size and the mass."""
    found = curve(seen, SPEED)
    (known,) = shape_std_devs(found, found.projection.candidates, [np.array([FRICTION])])
    velocity = seen.runs[0].record.velocity[:, 0]
    ratio = np.abs(velocity) / SPEED
    size = FRICTION * np.sign(velocity) * np.exp(-ratio)
    by_speed, by_exponent = size * ratio / SPEED, -size * ratio * np.log(np.maximum(ratio, 1e-9))
    jacobian = np.stack([by_speed, by_exponent, size / FRICTION, ACCELERATION], axis=1)
    expected = NOISE * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    assert known["speed"] == pytest.approx(expected[0], rel=0.1)
    assert known["exponent"] == pytest.approx(expected[1], rel=0.1)


def test_without_shapes_there_is_nothing_to_say(seen: Evidence) -> None:
    found = search(seen, [shaped("offset", normal(5, ROWS, 1))])
    assert shape_std_devs(found, found.projection.candidates, [np.ones(1)]) == [{}]


def test_refinement_finds_a_shape_between_points_of_the_grid(seen: Evidence) -> None:
    grid = sorted({one["speed"] for one in Candidate(REGISTRY["stribeck"], "axis").grid()})
    nearest = min(grid, key=lambda speed: abs(np.log(speed / SPEED)))
    assert nearest != pytest.approx(SPEED, rel=0.05)
    found = curve(seen, nearest)
    start = solve(found.projection, (0,))
    assert start is not None
    selection = ForwardSelection(found)
    refined = selection.refine(start)
    assert refined.gain > start.gain
    assert selection.search.projection.candidates[refined.numbers[0]].shape[
        "speed"
    ] == pytest.approx(SPEED, rel=0.06)


def test_refinement_stays_beside_its_point_of_the_grid(seen: Evidence) -> None:
    """The next point has neighbours of its own."""
    grid = sorted({one["speed"] for one in Candidate(REGISTRY["stribeck"], "axis").grid()})
    found = curve(seen, grid[0])
    selection = ForwardSelection(found)
    (refined,) = selection.sets(1)
    assert (
        grid[0]
        < selection.search.projection.candidates[refined.numbers[0]].shape["speed"]
        < grid[1]
    )
