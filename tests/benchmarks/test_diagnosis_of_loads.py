"""Whole diagnoses of a crane whose recordings carry different loads, in several orders."""

from dataclasses import replace
from itertools import islice, permutations
from pathlib import Path

import pytest
from unit.crane_identification.synthetic import FORCE_NOISE, crane_log, crane_model

from crane_identification import Log, Options
from crane_identification.diagnosis import page, words
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.report.content import Provenance
from crane_identification.thresholds import load_thresholds
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load

MASSES = {"a": 6.5, "b": 0.0, "c": 0.0, "d": 12.0, "e": 6.5}  # kg, of the recordings
HELD_OUT = {"f": 9.0, "g": 0.0}
ORDERS = 3


def log(name: str, mass: float) -> Log:
    """All begin at the same stamp, so that names alone tell them apart."""
    model = crane_model().with_term(Payload())
    theta = [*crane_model().theta, mass]
    carrying = model.with_estimate(theta, [0.0] * len(theta), "true values")
    return replace(crane_log(ord(name), 2, carrying, 30.0 * FORCE_NOISE), source=name)


@pytest.fixture(scope="module")
def recordings() -> tuple[list[Log], list[Log]]:
    training, held_out = (
        [log(name, mass) for name, mass in masses.items()] for masses in (MASSES, HELD_OUT)
    )
    return training, held_out


def test_loads_are_named_alike_in_any_order(
    recordings: tuple[list[Log], list[Log]], tmp_path: Path
) -> None:
    training, held_out = recordings
    said = []
    for order in islice(permutations(training), 0, 120, 120 // ORDERS):
        found = diagnose(crane_model(), order, held_out, Options(), load_thresholds())
        said.append(found.results().plain())
    first = said[0]
    assert all(one == first for one in said)
    assert first["verdict"] == "named"
    (finding,) = first["findings"]
    assert finding["effect"] == "payload"
    assert finding["carried_in"] == {
        "m_payload_1": ["a", "e"],
        "m_payload_2": ["d"],
        "none": ["b", "c"],
    }
    masses = [one["value"] for one in finding["parameters"]]
    assert masses == pytest.approx([6.5, 12.0], abs=0.2)
    weighed = {one["recording"]: one["value"] for one in first["model_error"]["loads"]}
    assert weighed == pytest.approx(HELD_OUT, abs=0.2)
    page.write(tmp_path / "report.html", found, Provenance.of("now", ["diagnose"], "model"))
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Each recording has its own load." in text
    assert "No load, from which masses count, in <code>b</code>, <code>c</code>." in text
    lines = "\n".join(words.lines(first))
    assert "no load, from which masses count, in b, c" in lines
    assert "each with its own load, estimated from it: f" in lines


def test_a_model_with_the_loads_of_other_recordings_is_asked_anew(
    recordings: tuple[list[Log], list[Log]],
) -> None:
    """Its numbers of runs meant others: they are no load of the recordings that have them here."""
    training, held_out = recordings
    elsewhere = Payload(loads=(Load(runs=(1,), recordings=("of another session",)),))
    known = crane_model().with_term(elsewhere)
    found = diagnose(known, training, held_out, Options(), load_thresholds())
    (finding,) = found.results().plain()["findings"]
    assert finding["carried_in"]["none"] == ["b", "c"]
