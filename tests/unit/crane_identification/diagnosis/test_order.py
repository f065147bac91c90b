"""A diagnosis does not depend on the order in which recordings are given, but on when they were."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.synthetic import AXIS_THETA, axis_log, axis_model

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import Verdict
from crane_identification.thresholds import load_thresholds
from crane_model import Model
from crane_model.terms import REGISTRY

STARTS = (0.0, 40.0, 150.0, 300.0, 420.0, 560.0)  # s, of recordings of 24 s
HELD_OUT = 2
COLD, WARMING = 40.0, 200.0  # N s/m beyond that of warm oil, s
SOUGHT = ("warm_up", "viscous_quadratic")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    return axis_model(tmp_path_factory.mktemp("axis"))


@pytest.fixture(scope="module")
def logs(model: Model) -> list[Log]:
    """A session in which the oil warms up, pauses included."""
    out = []
    for seed, start in enumerate(STARTS):
        log = axis_log(seed, model, periods=1)
        assert log.force is not None
        time = log.force.time
        speed = np.gradient(log.position.value[:, 0], time)[:, np.newaxis]
        more = COLD * speed * np.exp(-(start + time) / WARMING)[:, np.newaxis]
        force = Signal(time, log.force.value + more, "f")
        out.append(replace(log, start=1_735_689_600 * 10**9 + round(start * 1e9), force=force))
    return out


def diagnosed(model: Model, logs: list[Log], held_out: Log) -> Diagnosis:
    training = [log for log in logs if log is not held_out]
    without = {name for name, cls in REGISTRY.items() if cls.effect} - set(SOUGHT)
    return diagnose(
        model, training, [held_out], Options(), load_thresholds(), without=sorted(without)
    )


def test_oil_that_warms_up_over_a_session_is_named_in_any_order(
    model: Model, logs: list[Log]
) -> None:
    held_out = logs[HELD_OUT]
    found = diagnosed(model, logs, held_out)
    assert found.verdict is Verdict.NAMED
    (finding,) = found.findings
    assert finding.candidate.type == "warm_up"
    cold, warming = finding.parameters
    assert cold.value == pytest.approx(COLD, rel=0.05)
    assert warming.value == pytest.approx(WARMING, rel=0.1)
    assert found.after.theta[1] == pytest.approx(AXIS_THETA[1], rel=0.05)
    assert found.gap.after[0] < 0.5 * found.gap.before[0]  # the rest is noise
    shuffled = [logs[i] for i in (4, 1, 5, 0, 3, 2)]
    assert diagnosed(model, shuffled, held_out).results().plain() == found.results().plain()


def test_without_a_common_clock_the_answer_says_so(model: Model, logs: list[Log]) -> None:
    same = [replace(log, start=0) for log in logs[:3]]
    said = diagnosed(model, same, same[-1]).results().plain()
    assert said["clock"] is not None
    assert "axis 0 and axis 1 overlap" in said["clock"]
