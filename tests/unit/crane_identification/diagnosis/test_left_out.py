"""Breakaway that is over before a row is used, and breakaway that is not."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate, at_shape
from crane_identification.diagnosis.constants import LITTLE_SHARE
from crane_identification.diagnosis.diagnosis import _partly_seen
from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.visibility import left_out
from crane_model import DataError, Model, Record
from crane_model.terms import single_axis
from crane_model.terms.friction import Coulomb, TemperatureViscosity, Viscous
from crane_model.terms.presliding import Stiction
from crane_model.terms.term import Setting

STEP, SPEED, UNSEEN = 0.01, 0.05, 0.01  # s, m/s, m after a stop until rows are used
MODEL = Model("axis", Setting({"axis": "m"}, None), (single_axis.Inertia(joint="axis"),))


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    """To and fro by 0.2 m at one speed, with two seconds of rest before each way."""
    way, rest = np.full(400, SPEED), np.zeros(200)
    velocity = np.concatenate([rest, way, rest, -way] * 3)
    position = np.cumsum(velocity) * STEP
    since = np.concatenate([rest, np.cumsum(way) * STEP] * 6)  # m since it stood
    record = Record(
        ("axis",),
        STEP * np.arange(len(velocity)),
        position[:, None],
        velocity[:, None],
        np.zeros((len(velocity), 1)),
    )
    shown = since > UNSEEN + STEP * SPEED / 2.0
    gate = np.stack(
        [shown & (since > 3 * UNSEEN), shown & (since <= 3 * UNSEEN)],
        axis=1,
    )
    run = Run("bag", 0, record, gate.astype(float), 4)
    nothing = np.zeros((0, 2))
    return Evidence(
        MODEL, (run,), *np.zeros((3, 0)), nothing, np.zeros((0, 2, 1)), nothing.astype(bool)
    )


def candidates(evidence: Evidence, candidate: Candidate) -> list[ShapedCandidate]:
    """All shapes of a candidate."""
    return [at_shape(evidence, candidate, shape) for shape in candidate.grid()]


def test_the_share_of_a_peak_is_that_of_an_exponential(evidence: Evidence) -> None:
    """What fades as exp(-x/travel) has exp(-d/travel) of its norm beyond d."""
    for travel in (0.003, 0.01, 0.03):
        term = Stiction(joint="axis", travel=travel, dwell=0.2)
        assert evidence.shown(term).seen == pytest.approx(np.exp(-UNSEEN / travel), rel=0.01)


@pytest.mark.parametrize(("fast", "damped"), [(0.0, 1.0), (1.0, np.sqrt(0.5)), (3.0, np.sqrt(0.1))])
def test_rows_keep_of_an_effect_what_is_slower_than_they_are(fast: float, damped: float) -> None:
    """Viscous friction at 1 Hz and, `fast` times as large, at 30 Hz, by 25 rows a second."""
    time = STEP * np.arange(4000)
    velocity = np.sin(2.0 * np.pi * time) + fast * np.cos(60.0 * np.pi * time)
    none = np.zeros((len(time), 1))
    record = Record(("axis",), time, none, velocity[:, np.newaxis], none)
    gate = np.stack([np.ones(len(time)), np.zeros(len(time))], axis=1)
    run = Run("bag", 0, record, gate, 4)
    n = len(run.kept)
    used = np.stack([np.ones(n, dtype=bool), np.zeros(n, dtype=bool)], axis=1)
    there = Evidence(MODEL, (run,), *np.zeros((3, n)), np.zeros((n, 2)), np.zeros((n, 2, 1)), used)
    assert there.shown(Viscous(joint="axis")).damped == pytest.approx(damped, rel=0.02)


def test_a_signal_that_is_not_known_where_a_gate_is_shut_is_not_made_up(evidence: Evidence) -> None:
    (run,) = evidence.runs
    temperature = np.full(len(run.record), 30.0)
    known = replace(run, record=replace(run.record, temperature=temperature))
    term = TemperatureViscosity(joint="axis")
    assert replace(evidence, runs=(known,)).shown(term).columns.any()
    lost = np.where(run.gate.any(axis=1), temperature, np.nan)
    part = replace(run, record=replace(run.record, temperature=lost))
    with pytest.raises(DataError, match=r"temperature_viscosity.*not logged throughout"):
        replace(evidence, runs=(part,)).shown(term)


def test_a_short_peak_is_not_sought_and_its_share_in_used_rows_is_known(evidence: Evidence) -> None:
    candidate, usual = Candidate(Stiction, "axis"), Candidate(Coulomb, "axis")
    tried = [*candidates(evidence, candidate), *candidates(evidence, usual)]
    found = left_out(tried)
    travels = np.array([one.shape.get("travel", np.inf) for one in tried])
    np.testing.assert_array_equal(found.hidden, np.exp(-UNSEEN / travels) < LITTLE_SHARE)
    assert found.hidden.any() and not found.hidden.all()
    assert not found.whole and set(found.seen) == {candidate, usual}
    assert found.seen[candidate] == pytest.approx(np.exp(-2.0 * UNSEEN / travels.min()), rel=0.02)
    assert found.seen[usual] > 0.9


def test_friction_of_which_little_is_seen_is_listed_though_a_shape_of_it_is_sought(
    evidence: Evidence,
) -> None:
    """At some shape most of it is in used rows; at another one hardly any, and nobody knows which
    the machine has.
    """
    seen = left_out(candidates(evidence, Candidate(Stiction, "axis"))).seen
    (entry,) = _partly_seen(cast(Search, SimpleNamespace(seen=seen)))
    assert (entry.effect, entry.joint) == ("stiction", "axis")
    assert entry.seen_share is not None and entry.seen_share < LITTLE_SHARE**2


def test_where_no_row_is_used_none_of_it_is(evidence: Evidence) -> None:
    run = evidence.runs[0]
    blind = replace(evidence, runs=(replace(run, gate=np.zeros_like(run.gate)),))
    candidate = Candidate(Stiction, "axis")
    found = left_out(candidates(blind, candidate))
    assert found.hidden.all() and found.seen == {candidate: 0.0}
    assert "those that are used see 0.0% of it" in found.whole[candidate]
