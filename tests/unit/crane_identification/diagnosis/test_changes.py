"""What has changed since a model was made: its values are kept."""

import re
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.diagnosis.test_axis import FULL, model
from unit.crane_identification.experiments import experiment
from unit.crane_identification.synthetic import AXIS_THETA, axis_log, crane_model

from crane_identification import Log, Options, fit
from crane_identification.diagnosis import page, words
from crane_identification.diagnosis.candidates import candidates_of, changes_of
from crane_identification.diagnosis.decision import decide
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.findings import Verdict
from crane_identification.diagnosis.fit import Training, decimation, kept
from crane_identification.diagnosis.projection import whitened_base, whitener
from crane_identification.diagnosis.proof import extended
from crane_identification.diagnosis.search import search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.preparation.prepare import prepare
from crane_identification.report.content import Provenance
from crane_identification.thresholds import load_thresholds
from crane_model import ConfigurationError, Model, load_model, save_model
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load

F_C = 2  # index of Coulomb friction


def before(folder: Path) -> Model:
    """What the axis was, of a recording of its own."""
    axis = model(folder, *FULL)
    return fit(axis, [axis_log(100, axis, periods=2)]).model


def recorded(known: Model, *factors: float) -> list[Log]:
    """Four recordings of the axis, with its parameters times `factors`."""
    theta = AXIS_THETA * factors
    return [axis_log(seed, known, periods=2, theta=theta) for seed in range(4)]


def diagnosed(known: Model, friction: float = 1.0) -> Diagnosis:
    """The diagnosis with Coulomb friction times `friction`."""
    logs = recorded(known, 1.0, 1.0, friction, 1.0)
    return diagnose(known, logs[:3], logs[3:], Options(), load_thresholds(), fixed=True)


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnosed(before(tmp_path_factory.mktemp("worn")), friction=1.1)


def test_more_friction_is_named_with_its_size(worn: Diagnosis) -> None:
    assert worn.verdict is Verdict.NAMED
    (finding,) = worn.findings
    assert finding.candidate.changes and finding.candidate.type == "coulomb"
    change, std_dev = finding.parameters[0].change
    assert change == pytest.approx(0.1 * AXIS_THETA[F_C], abs=3.0 * std_dev)
    assert std_dev < 0.03


def test_the_model_holds_the_changed_value_and_the_others_as_they_were(
    worn: Diagnosis, tmp_path: Path
) -> None:
    save_model(tmp_path / "model.yaml", worn.after)
    written = load_model(tmp_path / "model.yaml")
    assert written.terms == worn.before.terms
    others = np.arange(len(FULL)) != F_C
    assert (written.theta[others] == worn.before.theta[others]).all()
    assert written.theta[F_C] == pytest.approx(1.1 * AXIS_THETA[F_C], rel=0.01)


def test_the_values_before_and_after_are_told(worn: Diagnosis) -> None:
    content = worn.results().plain()
    assert content["values_kept"] and content["findings"][0]["changed"]
    (value,) = content["findings"][0]["parameters"]
    assert value["before"] + value["change"] == pytest.approx(value["value"])
    assert value["change_std_dev"] > max(value["std_dev"], value["before_std_dev"])
    lines = words.lines(content)
    assert lines[0].startswith("Something has changed since the model was made")
    (said,) = (line for line in lines if "f_c.axis = 8.8" in line)
    (change,) = re.findall(r"\((.*)\)", said)
    assert re.fullmatch(r"\+0\.8\d+ ± 0\.01\d from 8\.00\d+ ± 0\.01\d", change)
    assert change in page.render(worn, Provenance.of("2012-06-01", ["diagnose"], "axis.yaml"))


def test_of_the_same_machine_nothing_has_changed(tmp_path: Path) -> None:
    result = diagnosed(before(tmp_path))
    assert result.verdict is Verdict.NONE and not result.findings
    assert words.lines(result.results().plain())[0].startswith("Nothing has changed")


def test_changes_of_one_joint_are_told_apart(tmp_path: Path) -> None:
    """Each of the model's own form, none of them by another name, and of the right size."""
    known = before(tmp_path)
    options = Options(average=False)
    runs = [p for log in recorded(known, 1.0, 1.1, 1.1, 1.2) for p in prepare(known, log, options)]
    evidence = kept(known, runs, decimation(known, runs, None))
    wanted = [*candidates_of(known, evidence), *changes_of(known)]
    found = search(evidence, wanted, load_thresholds())
    judged = decide(ForwardSelection(found)).passed
    assert {one.shaped.candidate for one in judged} <= set(changes_of(known))
    assert not any(one.indistinct for one in judged)
    _, values = extended(found, known, judged, Training(runs, 1, "all"))
    changed = {one.name: one.change for (one,) in values}
    assert set(changed) == {"f_v.axis", "f_c.axis", "offset.axis"}
    for name, size in (("f_v.axis", 3.0), ("f_c.axis", 0.8), ("offset.axis", -0.3)):
        change, std_dev = changed[name]
        assert change == pytest.approx(size, abs=3.5 * std_dev)


def test_what_the_values_leave_uncertain_is_no_finding(tmp_path: Path) -> None:
    """Ten times what the recordings would show, but each value is within its standard deviation."""
    known = model(tmp_path, *FULL)
    known = known.with_estimate(1.05 * AXIS_THETA, 0.05 * np.abs(AXIS_THETA), "a guess")
    result = diagnosed(known)
    assert result.verdict is Verdict.INSUFFICIENT and not result.findings
    assert "keep values that are better known" in result.reason


def test_values_that_are_kept_are_as_uncertain_as_they_say(tmp_path: Path) -> None:
    """Rows with their covariance are white beside the base."""
    rng = np.random.default_rng(1)
    n = 60
    axis = model(tmp_path, "inertia", "viscous").with_estimate(np.ones(2), np.ones(2), "")
    base = rng.standard_normal((n, 2, 3))
    base[:, :1, 2:] = 0.0
    zeros, used = np.zeros(n, dtype=int), np.ones((n, 2), dtype=bool)
    std_devs = np.array([0.01, 5.0])
    force = rng.standard_normal((n, 2))
    evidence = Evidence(axis, (), np.arange(n) * 0.1, zeros, zeros, force, base, used, std_devs)
    white = whitener(evidence, base)
    found = whitened_base(evidence, white).basis
    beside = np.eye(len(found)) - found @ found.T
    uncertain, nuisance = white(evidence.uncertain), white(evidence.free)
    covariance = beside @ (np.eye(len(found)) + uncertain @ uncertain.T) @ beside
    known = nuisance / np.linalg.norm(nuisance)
    np.testing.assert_allclose(covariance, np.eye(len(found)) - known @ known.T, atol=1e-9)


def test_a_load_in_all_recordings_is_weighed() -> None:
    """With the masses free it is a heavier telescope."""
    crane = crane_model()
    loaded = crane.with_term(Payload())
    loaded = loaded.with_estimate(np.append(crane.theta, 5.0), np.zeros(21), "true values")
    known = crane.with_estimate(crane.theta, 1e-3 * np.abs(crane.theta), "before")
    options = Options(average=False)
    runs = [
        p for seed in (1, 2) for p in prepare(known, experiment(seed, 1, model=loaded), options)
    ]
    found = search(kept(known, runs, 20), changes_of(known), load_thresholds())
    judged = decide(ForwardSelection(found)).passed
    assert [one.shaped.candidate.type for one in judged] == ["payload"]
    after, ((load,),) = extended(found, known, judged, Training(runs, 20, "both"))
    assert load.value == pytest.approx(5.0, abs=4.0 * load.std_dev) and load.std_dev < 0.3
    assert (after.theta[:-1] == known.theta).all()


def test_what_other_recordings_carried_is_not_kept() -> None:
    crane = crane_model()
    loaded = crane.with_term(Payload(loads=(Load(runs=(0, 2)),)))
    values = np.append(crane.theta, 5.0)
    kept = loaded.with_estimate(values, 0.1 * np.abs(values), "before").of_machine()
    assert kept.terms == crane.terms and (kept.theta == crane.theta).all()
    assert kept.std_devs == pytest.approx(0.1 * np.abs(crane.theta))
    everywhere = crane.with_term(Payload()).with_estimate(values, values, "before")
    assert everywhere.of_machine() == everywhere
    assert loaded.of_machine().values is None


def test_a_model_without_values_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError, match="'one axis' has no values that could have changed"
    ):
        diagnosed(model(tmp_path, *FULL))
