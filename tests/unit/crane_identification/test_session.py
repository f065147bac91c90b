"""Time that runs through a session by the stamps of its recordings."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.synthetic import axis_log, axis_model

from crane_identification import Log, Options, Session
from crane_identification.preparation.prepare import prepare_all

NOW = 1_735_689_600_123_456_789  # ns
HOUR = 3600.0


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """44 s."""
    return axis_log(1, axis_model(tmp_path_factory.mktemp("session")), periods=2)


def at(short: Log, *starts: float) -> list[Log]:
    return [
        replace(short, source=f"log {k}", start=NOW + round(start * 1e9))
        for k, start in enumerate(starts)
    ]


def test_time_counts_from_the_earliest_stamp_in_whatever_order(short: Log) -> None:
    starts = (0.0, 60.25, 400.000_000_5)
    for logs in permutations(at(short, *starts)):
        session = Session.of(logs)
        assert session.fallback is None
        found = {log.source: session.since(log) for log in logs}
        assert [found[f"log {k}"] for k in range(3)] == pytest.approx(starts, abs=1e-9)


def test_after_a_night_the_machine_is_cold_again(short: Log) -> None:
    logs = at(short, 0.0, 100.0, 16 * HOUR, 16 * HOUR + 100.0)
    session = Session.of(logs)
    assert [session.since(log) for log in logs] == [0.0, 100.0, 0.0, 100.0]


@pytest.mark.parametrize("second", [0.0, 30.0])
def test_stamps_that_overlap_are_no_clock_of_a_session(short: Log, second: float) -> None:
    logs = at(short, 0.0, second, 500.0)
    session = Session.of(logs)
    assert session.fallback is not None and "log 0 and log 1 overlap" in session.fallback
    assert [session.since(log) for log in logs] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("average", [False, True])
def test_the_time_of_a_record_is_that_of_the_session(
    short: Log, tmp_path: Path, average: bool
) -> None:
    """Of a mean over periods that of their middle; and no step of it is rounded."""
    model, options = axis_model(tmp_path), Options(average=average)
    alone, late = prepare_all(model, at(short, 0.0, 7200.5), options)
    np.testing.assert_allclose(late.record.time - alone.record.time, 7200.5, atol=1e-9)
    np.testing.assert_allclose(np.diff(late.record.time), late.step, rtol=1e-9)
    middle = float(late.record.time.mean()) - 7200.5
    assert middle == pytest.approx(22.0, abs=3.0)
