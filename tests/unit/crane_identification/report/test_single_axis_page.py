"""The page of a machine of one axis, whose recording is neither periodic nor has a reference."""

import numpy as np
import pytest
from unit.crane_identification.report.html_reader import Element, figure_descriptions, read_html

from crane_identification import Log, Options, Signal, fit
from crane_identification.preparation.prepare import prepare
from crane_identification.report import page, summary
from crane_identification.report.content import IdentificationReport, Provenance
from crane_identification.validation.force_validation import compare
from crane_model import Model
from crane_model.terms.friction import Coulomb, Viscous
from crane_model.terms.single_axis import Inertia, Offset
from crane_model.terms.term import Setting

TERMS = tuple(term(joint="axis") for term in (Inertia, Viscous, Coulomb, Offset))
MODEL = Model("one axis", Setting({"axis": "m"}, None), TERMS)


def record_axis(source: str, seed: int) -> Log:
    time = np.arange(3000) / 100.0
    frequencies = np.random.default_rng(seed).uniform(0.1, 0.5, 3)
    waves = [np.sin(2 * np.pi * f * time) for f in frequencies]
    position = 1e-5 * np.round(0.1 * np.sum(waves, axis=0)[:, np.newaxis] / 1e-5)
    velocity = np.gradient(position, 0.01, axis=0)
    force = 90 * np.gradient(velocity, 0.01, axis=0) + 200 * velocity + 20 * np.sign(velocity) - 3
    signals = {"position": position, "force": force}
    return Log(source, ("axis",), 0, **{k: Signal(time, v, k) for k, v in signals.items()})


def reported(model: Model) -> IdentificationReport:
    training, held_out = record_axis("train.csv", 0), record_axis("<held> & out.csv", 1)
    options = Options(average=False)
    fitted = fit(model, [training], options)
    data = tuple(prepare(MODEL, held_out, options))
    validations = tuple(compare(fitted.model, p, fitted.decimation) for p in data)
    provenance = Provenance.of("2012-06-01", ["identify"], "axis.yaml")
    return IdentificationReport(fitted, options, (training,), validations, (), provenance)


@pytest.fixture(scope="module")
def tree() -> Element:
    return read_html(page.render(reported(MODEL)))


def test_a_model_without_inertia_loses_the_simulated_motion_alone():
    """The held-out error stands on the page and in the summary, and so does the reason."""
    report = reported(MODEL.without_term(MODEL.terms[0]))
    rendered = read_html(page.render(report))
    assert "inertia of axis is 0 in the model" in rendered.find("p", id="not-simulated")[0].text
    assert not rendered.find("table", class_="stack motion")
    assert len(rendered.find("table", class_="errors")) == 1
    written = summary.summarize(report)
    motion = written.simulated_motion
    assert motion is not None and "inertia of axis is 0" in motion.reason
    assert motion.position_rms == {"axis": None}
    error = written.heldout_relative_error["axis"]
    assert error is not None and 0.0 < error < 1.0


def test_one_column_of_figures_without_reference_and_noise(tree):
    names = {
        key: [trace["name"] for trace in figure["data"]]
        for key, figure in figure_descriptions(tree).items()
    }
    assert names == {
        "recording-0-axis": ["measured"] * 3,
        "average-0-axis": ["estimated"] * 3,
        "validation-0-axis": ["measured", "model", "measured − model"],
    }


def test_no_entries_of_9_and_no_noise_floor(tree):
    assert not tree.find("table", class_="entries")
    (table,) = tree.find("table", class_="errors")
    assert "–" in table.text
    assert "noise not known" in tree.find("p", id="verdict")[0].text


def test_names_of_files_are_text_not_tags(tree):
    assert "<held> & out.csv" in tree.find("section", id="provenance")[0].text
    assert not tree.find("held")


def test_what_was_done_is_said(tree):
    assert "not averaged" in tree.find("section", id="conditions")[0].text
    assert "averaged over periods" not in tree.find("section", id="validation")[0].text


def test_only_what_is_drawn_has_a_key(tree):
    keys = [e.text for paragraph in tree.find("p", class_="key") for e in paragraph.find("span")]
    assert keys == [
        "measured",
        "estimated from the measurement",
        "sign of the velocity not known",
        "measured",
        "model",
        "sign of the velocity not known",
    ]
