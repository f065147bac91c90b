"""Friction before a joint slides, on narrow motions of a machine that carries one load."""

from pathlib import Path

from integration.discriminated import MODEL, RECORDINGS, HiddenCase, narrowly_recorded

from crane_identification import Options, fit, read_bag
from crane_identification.estimation.prior import load_prior
from crane_identification.recording_check.loads import split_by_load
from crane_model import load_model
from crane_model.progress_bar import silent

# The telescope moves at one speed.
PRIOR = "parameters: {f_v.telescope: {value: 2000.0, std_dev: 1000.0}}"


def test_presliding_on_a_narrow_motion_is_no_load_that_changes(tmp_path: Path) -> None:
    narrowly_recorded(tmp_path, HiddenCase("presliding", "inner_boom", 0.03))
    model, options = load_model(MODEL), Options()
    logs = tuple(read_bag(tmp_path / name, model.joints) for name, _ in RECORDINGS)
    (tmp_path / "prior.yaml").write_text(PRIOR, encoding="utf-8")
    prior = load_prior(tmp_path / "prior.yaml", model)
    fitted = fit(model, logs, options, silent, prior=prior).model
    assert split_by_load(fitted, logs, options) == (logs, ())
