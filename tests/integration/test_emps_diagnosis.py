"""EMPS with symmetric friction: real, and never quite as any model has it."""

from dataclasses import replace
from pathlib import Path

import pytest
from integration.emps_published import recording

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.diagnosis.findings import Verdict
from crane_identification.thresholds import load_thresholds
from crane_model import load_model

SYMMETRIC = """
name: EMPS, friction alike in both directions
joints: {axis: m}
terms:
  - {type: inertia, joint: axis}
  - {type: viscous, joint: axis}
  - {type: coulomb, joint: axis}
"""


def part(log: Log, low: float, high: float) -> Log:
    """From one share of a recording to another."""
    assert log.force is not None
    first, last = (int(share * len(log.position.time)) for share in (low, high))

    def cut(signal: Signal) -> Signal:
        return replace(signal, time=signal.time[first:last], value=signal.value[first:last])

    position, force = cut(log.position), cut(log.force)
    return replace(log, source=f"{low} to {high}", position=position, force=force)


@pytest.mark.parametrize(
    ("training", "held_out", "verdict"),
    [
        ([(0.0, 0.7)], [(0.7, 1.0)], Verdict.AND_MORE),
        ([(0.0, 0.3), (0.6, 1.0)], [(0.3, 0.6)], Verdict.AND_MORE),
        # too little for the learner to find more
        ([(0.2, 0.4), (0.6, 0.8)], [(0.0, 0.2), (0.4, 0.6)], Verdict.NAMED),
    ],
)
def test_friction_that_depends_on_the_direction_is_named_first(
    real_data: Path, tmp_path: Path, training: list, held_out: list, verdict: Verdict
) -> None:
    """Though a learner finds more than that; published is -36.9 N s/m."""
    (tmp_path / "axis.yaml").write_text(SYMMETRIC, encoding="utf-8")
    model = load_model(tmp_path / "axis.yaml")
    log = recording(real_data, model.joints)
    train, validate = ([part(log, *ends) for ends in some] for some in (training, held_out))
    found = diagnose(model, train, validate, Options(), load_thresholds())
    assert found.verdict is verdict
    first = found.findings[0]
    assert first.candidate.type == "viscous_asymmetry" and not first.judged.indistinct
    assert first.judged.margin > first.judged.needed
    assert (first.judged.held_out > 0.0).all()
    assert first.parameters[0].value == pytest.approx(-38.0, abs=5.0)
    assert found.gap.after[0] < 0.5 * found.gap.before[0]
    more = verdict is Verdict.AND_MORE
    assert ("a systematic residual is left" in found.reason) is more
    assert found.results().plain()["left"]["axis"]["systematic"] is more
