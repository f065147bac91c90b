"""An unknown force that is a difference between recordings: which, and in which parameter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from unit.crane_identification.diagnosis.test_axis import FULL, model
from unit.crane_identification.synthetic import axis_log

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis.candidates import wanted
from crane_identification.diagnosis.findings import UnknownPlace
from crane_identification.diagnosis.fit import fitted
from crane_identification.diagnosis.residuals import unknown_force
from crane_identification.diagnosis.search import search
from crane_identification.diagnosis.words import unknown as told
from crane_identification.thresholds import load_thresholds
from crane_model.progress_bar import silent

SEEDS = range(4)  # three recordings to train on
STIFFER = 1  # the one of them that differs
MORE = 30.0  # N s/m of viscous friction in it


def of_recordings(folder: Path, more: float) -> UnknownPlace:
    one = model(folder, *FULL)
    logs = [stiffened(axis_log(seed, one, periods=2), more * (seed == STIFFER)) for seed in SEEDS]
    fit = fitted(one, logs[:-1], logs[-1:], Options(), False, silent)
    return unknown_force(search(fit.evidence, wanted(fit, ()), load_thresholds()), 0)


def stiffened(log: Log, more: float) -> Log:
    assert log.force is not None
    velocity = np.gradient(log.position.value[:, 0], log.position.time)[:, np.newaxis]
    force = log.force.value + more * velocity
    return replace(log, force=Signal(log.force.time, force, "f"))


def test_what_differs_between_recordings_is_named_with_its_size(tmp_path: Path) -> None:
    found = of_recordings(tmp_path, MORE).difference
    assert found is not None
    assert found.parameter.startswith("f_v") and (found.explained_share or 0.0) > 0.8
    changes = list(found.changes.values())
    assert np.argmax(changes) == STIFFER
    others = np.delete(changes, STIFFER)
    np.testing.assert_allclose(changes[STIFFER] - others, MORE, rtol=0.2)


def test_recordings_that_are_alike_do_not_differ(tmp_path: Path) -> None:
    assert of_recordings(tmp_path, 0.0).difference is None


def test_the_difference_is_said_with_its_recordings() -> None:
    unknown = {
        "signatures": [],
        "recordings": {"second": 3.1},
        "difference": {
            "parameter": "f_v_axis",
            "unit": "N s/m",
            "explained_share": 0.93,
            "changes": {"first": -10.0, "second": 20.0, "third": 0.2},
            "std_devs": {"first": 0.5, "second": 0.5, "third": 0.5},
        },
    }
    more, differ = told({"unknown": unknown})
    assert more == "it is far larger than in most recordings in second (3.1 times)"
    assert "f_v_axis of each by itself explains 93" in differ
    assert "in first" in differ and "in second" in differ and "third" not in differ
