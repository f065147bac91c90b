"""What each recording carries, found in whatever recordings it is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.candidates import (
    agreeing,
    candidates_of,
    one_each,
    weighed,
)
from crane_identification.diagnosis.evidence import Evidence, gather
from crane_identification.diagnosis.fit import refit
from crane_identification.diagnosis.search import search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_identification.thresholds import load_thresholds
from crane_model import Model
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load

MASSES = (0.0, 6.5, 0.0, 6.5, 12.0)  # kg, of the recordings to train on
HELD_OUT = 4.0
FACTOR = 20


def loaded(seed: int, mass: float) -> Preparation:
    """20 s of a crane that carries a mass, gapless."""
    model = crane_model()
    theta = np.append(model.theta, mass)
    carrying = model.with_term(Payload()).with_estimate(theta, 0.0 * theta, "true values")
    log = replace(crane_log(seed, 1, carrying), source=f"recording {seed}")
    return prepare(model, log, Options(average=False))[0]


@pytest.fixture(scope="module")
def recordings() -> list[Preparation]:
    return [loaded(seed, mass) for seed, mass in enumerate(MASSES)]


def sought(preparations: Sequence[Preparation]) -> ForwardSelection:
    """The search for a load alone."""
    evidence = gather(crane_model(), preparations, FACTOR)
    wanted = [one for one in candidates_of(crane_model(), evidence) if one.type == "payload"]
    return ForwardSelection(search(evidence, wanted, load_thresholds()))


def found(selection: ForwardSelection) -> tuple[tuple[Load, ...], np.ndarray, float]:
    """The loads that are found, their masses, and their gain."""
    subset = selection.best(1)
    assert subset is not None
    (number,) = subset.numbers
    projection = selection.search.projection
    term = projection.candidates[number].term
    assert isinstance(term, Payload) and term.loads is not None
    values = subset.values / projection.scale[projection.columns_of[number]]
    return term.loads, values, subset.gain


def test_loads_are_found_in_any_recordings_and_in_any_order(recordings: list[Preparation]) -> None:
    """Two different ones, and none in two recordings, from which they count."""
    gains = []
    for order in ([0, 1, 2, 3, 4], [4, 2, 1, 0, 3], [3, 1, 0, 4, 2]):
        loads, masses, gain = found(sought([recordings[i] for i in order]))
        assert [load.recordings for load in loads] == [
            ("recording 1", "recording 3"),
            ("recording 4",),
        ]
        assert [load.runs for load in loads] == [
            tuple(sorted((order.index(1), order.index(3)))),
            (order.index(4),),
        ]
        assert masses == pytest.approx([6.5, 12.0], abs=0.1)
        gains.append(gain)
    assert gains == pytest.approx([gains[0]] * 3, rel=1e-4)


def test_what_an_effect_takes_from_the_model_is_what_that_is_beside_it(
    recordings: list[Preparation],
) -> None:
    """The bodies behind the zero of an encoder, from a model that starts with wrong ones."""
    model = crane_model()
    evidence = gather(model, [recordings[0], recordings[2]], FACTOR)
    wrong = model.with_estimate(1.3 * model.theta, 0.0 * model.theta, "wrong")
    zeros = [one for one in candidates_of(wrong, evidence) if one.type == "encoder_offset"]
    assert [one.joint for one in zeros] == ["inner_boom", "outer_boom"]
    for one in zeros:
        bodies = dict(one.given)["bodies"]
        assert bodies == pytest.approx(model.theta[:8].tolist(), rel=0.1)
        assert one.at({}).bodies == bodies


def test_more_loads_than_differ_are_not_kept(recordings: list[Preparation]) -> None:
    """They gain more, and may have looked different while another effect was missing."""
    selection = sought(recordings)
    candidate = selection.search.projection.candidates[0].candidate
    selection.added(candidate, {"loads": one_each(selection.search.evidence)[1:]})
    assert len(found(selection)[0]) == 2


@settings(max_examples=25)
@given(st.permutations(range(6)), st.integers(0, 100))
def test_masses_that_agree_are_one_group_in_whatever_order(order: list[int], seed: int) -> None:
    """Of six recordings, about a common mass that is not determined."""
    rng = np.random.default_rng(seed)
    true = np.array([0.0, 0.0, 5.0, 5.0, 5.0, 9.0])[order]
    power = rng.uniform(200.0, 2000.0, 6)
    information = np.diag(power) - np.outer(power, power) / power.sum()
    score = information @ true + np.linalg.cholesky(np.diag(power)) @ rng.uniform(-1, 1, 6)
    groups = agreeing(information, score, 1.0)
    assert [sorted(order[i] for i in group) for group in groups] == [[0, 1], [2, 3, 4], [5]]


def test_what_differs_by_less_than_a_load_that_is_no_point_is_one_group() -> None:
    """However well it is determined."""
    information = 1e6 * (np.eye(4) - 0.25)
    groups = agreeing(information, information @ np.array([0.0, 10.0, 0.1, 10.2]), 1.0)
    assert groups == [[0, 2], [1, 3]]


@pytest.fixture(scope="module")
def held_out() -> tuple[Preparation, Preparation]:
    return loaded(11, HELD_OUT), loaded(12, 0.0)


def on(model: Model, evidence: Evidence, held_out: Sequence[Preparation]):
    """The model with what the held-out recordings carry, these loads, and what is left there."""
    fitted = refit(evidence, "made up")
    other = gather(fitted, held_out, FACTOR, first_run=len(evidence.runs))
    usual = evidence.rms(evidence.residual(fitted))
    carrying, loads = weighed(fitted, other, other.residual(fitted), usual)
    return loads, other.rms(other.residual(carrying))[:3] / usual[:3]


def test_a_held_out_recording_is_weighed_by_itself(
    recordings: list[Preparation], held_out: tuple[Preparation, Preparation]
) -> None:
    """With the loads of training, and without any: then only a load that stands out counts."""
    loads, _, _ = found(sought(recordings))
    model = crane_model().with_term(Payload(loads=loads))
    known, left = on(model, gather(model, recordings, FACTOR), held_out)
    assert [(one.recording, one.found) for one in known] == [
        ("recording 11", False),
        ("recording 12", False),
    ]
    assert [one.mass for one in known] == pytest.approx([HELD_OUT, 0.0], abs=0.15)
    assert (left < 1.5).all()
    empty = crane_model()
    news, left = on(empty, gather(empty, [recordings[0], recordings[2]], FACTOR), held_out)
    assert [(one.recording, one.found) for one in news] == [("recording 11", True)]
    assert news[0].mass == pytest.approx(HELD_OUT, abs=0.15)
    assert (left < 2.0).all()
