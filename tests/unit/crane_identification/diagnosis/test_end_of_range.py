"""A cushion at an end to which one recording of six comes: seen, sought, asked and held to there.

Telescopes of made-up motion, at every row of which the noise is one newton.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from crane_identification.diagnosis.candidates import Candidate, at_shape
from crane_identification.diagnosis.constants import TIME_BLOCKS
from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.gap import where_trained
from crane_identification.diagnosis.judgement import (
    Judged,
    all_judged,
    folds,
    folds_of,
    helps,
)
from crane_identification.diagnosis.projection import NOTHING, solve
from crane_identification.diagnosis.search import search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.signals.gated import CYCLES
from crane_identification.thresholds import load_thresholds
from crane_model import Model, Record, load_machine
from crane_model.terms import Setting
from crane_model.terms.single_axis import EndCushioning, Inertia

JOINT, LOWEST, HIGH = "telescope", 0.5, 1.55  # m, where it goes at least, and where it ends
ROWS, STEP = 240, 0.1  # of a recording; s
ZONE, TURBULENT = 0.2, 4e4  # m, N s2/m2
MODEL = Model(JOINT, Setting({JOINT: "m"}, load_machine()), (Inertia(joint=JOINT),))
CUSHION = Candidate(EndCushioning, JOINT)
FAR, NEAR = 0.4, 0.04  # m, how close to the upper end a recording comes


def record(closest: float, seed: int, times: float = 3.0) -> Record:
    """So many times to and fro, up to `closest` before the end."""
    t = STEP * np.arange(ROWS)
    w = 2.0 * np.pi * times / (STEP * ROWS)
    size = (HIGH - closest - LOWEST) / 2.0
    middle = LOWEST + size
    q, v, a = (
        one[:, np.newaxis]
        for one in (
            np.round(middle - size * np.cos(w * t), 9),  # all begin at one place
            size * w * np.sin(w * t),
            size * w**2 * np.cos(w * t),
        )
    )
    force = 50.0 * a + np.random.default_rng(seed).standard_normal((ROWS, 1))
    depth = np.maximum(0.0, 1.0 - (HIGH - q) / ZONE)
    return Record((JOINT,), t, q, v, a, force=force + TURBULENT * v * np.abs(v) * depth)


def evidence(closest: Sequence[float], times: float = 3.0) -> Evidence:
    """Rows of recordings, each of which comes so close to the upper end."""
    gate = np.repeat([[1.0, 0.0]], ROWS, axis=0)
    records = [record(one, seed, times) for seed, one in enumerate(closest)]
    runs = tuple(Run(f"bag {k}", k, one, gate, 1) for k, one in enumerate(records))
    number = np.repeat(np.arange(len(runs)), ROWS)
    force = np.concatenate([run.filtered(run.record.force[..., None])[..., 0] for run in runs])  # type: ignore[index]
    base = np.concatenate([run.filtered(MODEL.regressor(run.record)) for run in runs])
    time = np.concatenate([one.time for one in records])
    used = np.repeat([[True, False]], len(force), axis=0)
    return Evidence(MODEL, runs, time, number, number, force, base, used)


def judged(closest: Sequence[float], times: float = 3.0) -> Judged:
    selection = ForwardSelection(search(evidence(closest, times), [CUSHION], load_thresholds()))
    best = selection.best(1)
    assert best is not None
    return all_judged(selection.search, best)[0]


@pytest.mark.parametrize(("closest", "ends"), [(NEAR, ("upper",)), (FAR, ("lower", "upper"))])
def test_ends_are_those_that_the_recordings_visit(closest: float, ends: tuple[str, ...]) -> None:
    """With neither visited, the term stays whole, and does not show."""
    shaped = at_shape(evidence([closest] * 2), CUSHION, {"zone": ZONE})
    assert isinstance(shaped.term, EndCushioning)
    assert shaped.term.ends == ends
    assert shaped.columns.any() == (closest == NEAR)
    assert shaped.positive.tolist() == [True] * 2 * len(ends)


def test_parameters_of_an_end_that_was_not_visited_are_said_not_to_show() -> None:
    made = search(evidence([NEAR] * 2), [CUSHION], load_thresholds())
    assert made.unobservable[CUSHION].startswith("f_lower.telescope, h_lower.telescope: no rec")
    assert CUSHION in {one.candidate for one in made.projection.candidates}
    neither = search(evidence([FAR] * 2), [CUSHION], load_thresholds())
    assert neither.unobservable == {} and CUSHION in neither.untestable


def test_a_zone_is_found_from_either_point_of_the_grid_beside_it() -> None:
    selection = ForwardSelection(search(evidence([NEAR] * 4), [CUSHION], load_thresholds()))
    candidates = selection.search.projection.candidates
    widest = max(range(len(candidates)), key=lambda k: candidates[k].shape["zone"])
    start = solve(selection.search.projection, (widest,))
    assert start is not None and candidates[widest].shape["zone"] == pytest.approx(0.3)
    refined = selection.refine(start)
    found = selection.search.projection.candidates[refined.numbers[0]]
    assert found.shape["zone"] == pytest.approx(ZONE, rel=0.02)


def test_an_effect_is_asked_in_the_one_recording_in_which_it_acts() -> None:
    """In blocks of time, each with a share of its energy; recordings say nothing elsewhere."""
    found = judged([FAR, FAR, NEAR, FAR, FAR, FAR])
    assert found.fold_names == tuple(f"block {k + 1} of {TIME_BLOCKS}" for k in range(TIME_BLOCKS))
    assert (found.held_out > 10.0).all()
    assert helps(found.held_out, load_thresholds())


def test_of_several_recordings_those_are_asked_in_which_it_acts() -> None:
    found = judged([FAR, NEAR, NEAR, FAR, NEAR, FAR])
    assert found.fold_names == ("bag 1", "bag 2", "bag 4")
    assert (found.held_out > 100.0).all()


def test_what_happens_once_is_no_law() -> None:
    """In, and not out again: it may be anything that happened there."""
    found = judged([FAR, FAR, FAR, FAR, FAR, NEAR], times=0.5)
    assert found.fold_names == tuple(f"bag {k}" for k in range(6))
    assert np.isnan(found.held_out[5])


def test_blocks_hold_as_much_of_the_force_each() -> None:
    given = evidence([FAR, FAR, NEAR, FAR, FAR, FAR])
    made = search(given, [CUSHION], load_thresholds())
    force = at_shape(given, CUSHION, {"zone": ZONE}).columns[:, :, 1]
    asked = folds_of(given, made.whitener, force)
    assert set(given.bag[asked.fold >= 0].tolist()) == {2}
    energy = np.bincount(made.whitener.row, made.whitener(force) ** 2, len(force))
    shares = np.bincount(asked.fold[asked.fold >= 0], energy[asked.fold >= 0]) / energy.sum()
    np.testing.assert_allclose(shares, 1.0 / TIME_BLOCKS, atol=0.06)
    everywhere = folds_of(given, made.whitener, given.base[:, :, 0])
    assert everywhere.names == folds(given).names


@pytest.mark.parametrize("factor", [1, 4])
def test_a_name_is_held_to_rows_that_see_where_training_went(factor: int) -> None:
    """Not to those whose filter reaches beyond, half its length to either side."""
    training, beyond = evidence([0.2] * 4), evidence([NEAR])
    run = replace(beyond.runs[0], factor=factor)
    kept = beyond.used[run.kept]
    held_out = replace(beyond, runs=(run,), used=kept)
    outside = run.record.position[:, 0] > HIGH - 0.2
    reach = 0 if factor == 1 else CYCLES * factor // 2
    near = [outside[max(k - reach, 0) : k + reach + 1].any() for k in run.kept]
    assert 0 < sum(near) < len(near)
    seen = where_trained(training, held_out)
    np.testing.assert_array_equal(seen.used[:, 0], ~np.array(near))
    assert where_trained(beyond, training).used.sum() == training.used.sum()


def test_nothing_is_found_where_nothing_was_visited() -> None:
    selection = ForwardSelection(search(evidence([FAR] * 4), [CUSHION], load_thresholds()))
    assert selection.best(1) in (None, NOTHING)
