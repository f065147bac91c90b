"""Whole diagnoses of one axis: cheap, with every verdict."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from integration.browser import installed, opened
from unit.crane_identification.report.html_reader import Element, read_html
from unit.crane_identification.synthetic import axis_log

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis import page, words
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import Verdict
from crane_identification.diagnosis.residuals import regions
from crane_identification.report.content import Provenance
from crane_identification.thresholds import load_thresholds
from crane_model import ConfigurationError, Model, load_model, save_model

FULL = ("inertia", "viscous", "coulomb", "offset")
SEEDS = range(4)
PULSATION = 2.7  # Hz


def model(folder: Path, *types: str) -> Model:
    terms = "".join(f"  - {{type: {name}, joint: axis}}\n" for name in types)
    (folder / "axis.yaml").write_text(f"name: one axis\njoints: {{axis: m}}\nterms:\n{terms}")
    return load_model(folder / "axis.yaml")


def log(folder: Path, seed: int, law: str = "") -> Log:
    """An axis that obeys the full model, plus 3 N rms of another `law`."""
    made = axis_log(seed, model(folder, *FULL), periods=2)
    assert made.force is not None
    q = made.position.value
    v = np.gradient(q[:, 0], made.position.time)[:, None]
    time = (made.force.time - made.force.time[0])[:, np.newaxis]
    added = {
        "": 0.0 * q,
        "spring": q,
        "waves": np.sin(30.0 * q) * np.cos(9.0 * v),
        "pulsation": np.sin(2.0 * np.pi * PULSATION * time + seed),
    }[law]
    size = float(np.sqrt((added**2).mean())) or 1.0
    force = Signal(made.force.time, made.force.value + 3.0 * added / size, "f")
    return replace(made, force=force)


@pytest.fixture(scope="module")
def without_page(without_coulomb: Diagnosis) -> Element:
    provenance = Provenance.of("2012-06-01", ["diagnose"], "axis.yaml")
    return read_html(page.render(without_coulomb, provenance))


def diagnosed(
    folder: Path, types: tuple[str, ...], law: str = "", without: tuple[str, ...] = ()
) -> Diagnosis:
    logs = [log(folder, seed, law) for seed in SEEDS]
    lacking = model(folder, *types)
    return diagnose(lacking, logs[:-1], logs[-1:], Options(), load_thresholds(), without=without)


@pytest.fixture(scope="module")
def without_coulomb(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnosed(tmp_path_factory.mktemp("axis"), ("inertia", "viscous"))


def test_the_missing_terms_are_named_strongest_first(without_coulomb: Diagnosis) -> None:
    """Coulomb friction of 8 N, then the offset of -1.5 N; both with their values."""
    assert without_coulomb.verdict in (Verdict.NAMED, Verdict.AMBIGUOUS)
    first, second = without_coulomb.findings
    assert first.candidate.type == "coulomb" and not first.judged.indistinct
    assert {second.candidate.type, *(m.type for m in second.judged.indistinct)} >= {"offset"}
    value = first.parameters[0]
    assert value.value == pytest.approx(8.0, abs=4 * value.std_dev + 0.1)
    assert second.parameters[0].value == pytest.approx(-1.5, abs=0.2)


def test_the_gap_closes_on_the_held_out_recording(without_coulomb: Diagnosis) -> None:
    gap = without_coulomb.gap
    assert gap.closed[0] > 0.95
    assert gap.after[0] < 1.5 * gap.floor[0]
    assert (gap.motion_after.position_rms < 0.5 * gap.motion_before.position_rms).all()


def test_a_complete_model_lacks_nothing(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, FULL)
    assert result.verdict is Verdict.NONE
    assert not result.findings and result.after is result.before
    assert not result.warnings


def test_what_is_wrong_with_recordings_is_told(tmp_path: Path) -> None:
    """What had to be mended, and a period that the held-out recording does not have."""
    logs = [replace(log(tmp_path, seed), notes=(f"mended {seed}",)) for seed in SEEDS]
    options = Options(period=13.0)
    result = diagnose(model(tmp_path, *FULL), logs[:-1], logs[-1:], options, load_thresholds())
    content = result.results().plain()
    assert [one for one in content["warnings"] if "mended" in one] == [
        f"axis {seed}: mended {seed}." for seed in SEEDS
    ]
    assert "axis 3: the motion does not repeat after the given period" in content["warnings"][-1]
    assert "it repeats after 20 s" in content["warnings"][-1]
    assert "--no-average" not in content["warnings"][-1]
    shown = page.render(result, Provenance.of("2012-06-01", ["diagnose"], "axis.yaml"))
    assert all(one in shown for one in content["warnings"])


def test_a_spring_is_named(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, FULL, "spring")
    assert result.verdict is Verdict.NAMED
    assert [one.candidate.type for one in result.findings] == ["hose_stiffness"]


def test_without_its_entry_a_spring_is_not_given_another_name(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, FULL, "spring", without=("hose_stiffness",))
    assert result.verdict is Verdict.UNKNOWN and not result.findings
    assert result.results().plain()["without"] == ["hose_stiffness"]


def test_an_effect_that_is_not_in_the_catalogue_is_not_left_out(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="nonsense: no effect that shows in the force"):
        diagnosed(tmp_path, FULL, without=("nonsense",))


def test_a_law_that_is_not_in_the_catalogue_is_not_given_a_name(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, FULL, "waves")
    assert result.verdict is Verdict.UNKNOWN
    assert not result.findings
    (where,) = regions(result.fit, result.proof.before)
    assert where is not None and "axis" in where.variable


def test_a_pulsation_is_unknown_and_listed(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, FULL, "pulsation")
    assert found.verdict is Verdict.UNKNOWN
    assert f"pulsates at {PULSATION:.2f} Hz" in found.reason
    (line,) = found.results().plain()["pulsations"]
    assert line["joint"] == "axis" and line["frequency"] == pytest.approx(PULSATION, abs=0.02)


def test_a_model_that_errs_more_on_the_held_out_recording_is_warned_of(tmp_path: Path) -> None:
    logs = [log(tmp_path, seed) for seed in SEEDS]
    other = log(tmp_path, 9, "spring")
    result = diagnose(model(tmp_path, *FULL), logs, [other], Options(), load_thresholds())
    (warning,) = result.results().plain()["warnings"]
    assert "does not carry over to the held-out recordings: there it errs by" in warning
    assert warning in page.render(result, Provenance.of("2012-06-01", ["diagnose"], "axis.yaml"))


def test_what_effects_leave_where_they_act_is_known(without_coulomb: Diagnosis) -> None:
    """All of them leave noise; the weakest alone leaves most of what the others explain."""
    search = without_coulomb.search
    options = [finding.judged.shaped for finding in without_coulomb.findings]
    assert abs(search.left_share(options)) < 0.1
    assert search.left_share(options[-1:]) > 0.5
    assert search.left_share([]) == 0.0


def test_the_extended_model_loads_and_lacks_nothing_more(
    without_coulomb: Diagnosis, tmp_path: Path
) -> None:
    save_model(tmp_path / "model.yaml", without_coulomb.after)
    extended = load_model(tmp_path / "model.yaml")
    assert extended.values == pytest.approx(without_coulomb.after.theta)
    logs = [log(tmp_path, seed) for seed in SEEDS]
    again = diagnose(extended, logs[:-1], logs[-1:], Options(), load_thresholds())
    assert again.verdict is Verdict.NONE


def test_findings_hold_every_key(without_coulomb: Diagnosis) -> None:
    content = without_coulomb.results().plain()
    assert {"verdict", "where", "findings", "model_error", "left"} <= set(content)
    assert set(content["findings"][0]) >= {
        *("effect", "name", "joint", "ambiguity_group", "parameters", "score", "threshold"),
        *("runner_up", "margin", "discriminated_by"),
    }
    assert set(content["findings"][0]["parameters"][0]) == {
        *("name", "value", "std_dev", "unit", "minimum", "determined"),
    }
    assert set(content["where"]["axis"]) >= {"energy_share", "region"}


def test_the_explanation_names_what_the_page_names(
    without_coulomb: Diagnosis, without_page: Element
) -> None:
    """Coulomb friction, and all members of a class, with the gap that proves it."""
    content = without_coulomb.results().plain()
    lines = words.lines(content)
    assert "Coulomb friction (axis)" in lines[0] and "constant force (axis)" in lines[0]
    assert any(line.startswith("Held-out error") for line in lines[:3])
    (headline,) = without_page.find("p", id="verdict")
    assert " ".join(headline.text.split()) == lines[0]


def test_the_explanation_cuts_nothing(without_coulomb: Diagnosis) -> None:
    """However many findings there are, each has its proof; what is elsewhere is said."""
    content = without_coulomb.results().plain()
    many = [{**content["findings"][0], "score": 1000.0 + i} for i in range(9)]
    lines = words.lines(content | {"findings": many})
    assert lines[2].startswith("Held-out error")
    for i in range(9):
        assert any(line.startswith(f"   score {1000 + i}, threshold") for line in lines)
    assert lines[-1].startswith("Not printed: ") and "findings.json" in lines[-1]


def test_the_page_links_what_it_is_of(without_page: Element) -> None:
    addresses = [one.attributes["href"] for one in without_page.find("a")]
    assert {"model.yaml", "findings.json", "axis.yaml", "#finding-1"} <= set(addresses)


def test_the_strength_is_that_of_the_whole_effect(without_coulomb: Diagnosis) -> None:
    """8 N of Coulomb friction, over the rms of the force; less shows beside viscous friction."""
    (first, *_), evidence = without_coulomb.results().plain()["findings"], without_coulomb.training
    assert first["relative_magnitude"] == pytest.approx(8.0 / evidence.force_rms[0], rel=0.1)
    assert first["visible_magnitude"] < 0.6 * first["relative_magnitude"]


def test_pictures_have_words(without_page: Element) -> None:
    for place in without_page.find("div", class_="plot"):
        assert len(place.attributes["aria-label"]) > 20 and place.attributes["role"] == "img"


def test_the_report_is_drawn_by_a_real_browser(without_coulomb: Diagnosis, tmp_path: Path) -> None:
    """Three figures of each finding, and not a word on the console."""
    provenance = Provenance.of("2012-06-01", ["diagnose"], "axis.yaml")
    seen = opened(installed(), tmp_path, page.render(without_coulomb, provenance))
    assert seen.console == []
    cards = seen.page.find("article", class_="finding")
    assert len(cards) == len(without_coulomb.findings) == 2
    assert len(seen.plots()) == 3 * len(cards)
    for card, finding in zip(cards, without_coulomb.findings, strict=True):
        assert finding.candidate.effect.name in card.find("h3")[0].text
        bars = card.find("g", class_="bars")
        assert len(bars) == 1 and bars[0].find("path")  # folds
        assert len(card.find("path", class_="js-line")) >= 4
