"""Diagnoses of a six-axis robot that is known: measured motion, with forces of a model and noise.

The motion is that of the KUKA KR300, the values are those of its model fitted to the measurements.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crane_identification import ColumnMap, Log, Options, Signal, fit
from crane_identification.data.bad_samples import usable
from crane_identification.data.table_log import read_table
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.preparation.prepare import prepare
from crane_identification.thresholds import load_thresholds
from crane_model import Model, Record, load_model
from crane_model.configuration import load

MACHINES = Path(__file__).parents[1] / "machines"
OPTIONS = Options(average=False)
NOISE, MEMORY = 0.01, 0.9  # of the rms force, and from one sample to the next

Law = Callable[[Record], np.ndarray]


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(MACHINES / "kuka_kr300_model.yaml")


@pytest.fixture(scope="module")
def robot(real_data: Path, model: Model) -> Callable[[Law], list[Log]]:
    """Recordings A, B and C of a robot that obeys the model, and a further law."""
    columns = load(MACHINES / "kuka_kr300_columns.yaml", ColumnMap)
    logs = [
        usable(
            read_table(real_data / "kuka_kr300" / f"kuka_{name}.parquet", columns, model.joints),
            1.8,
            8.2,
        )
        for name in "ABC"
    ]
    motions = [prepare(model, log, OPTIONS) for log in logs]
    known = fit(model, logs[:2], OPTIONS).model

    def made(law: Law) -> list[Log]:
        noise = np.random.default_rng(1)
        out = []
        for log, (one,) in zip(logs, motions, strict=True):
            force = known.regressor(one.record) @ known.theta + law(one.record)
            random = noise.standard_normal(force.shape)
            for i in range(1, len(random)):
                random[i] = MEMORY * random[i - 1] + np.sqrt(1.0 - MEMORY**2) * random[i]
            force += NOISE * np.sqrt((force**2).mean(axis=0)) * random
            time = one.record.time
            inside = (log.position.time >= time[0]) & (log.position.time <= time[-1])
            place = Signal(log.position.time[inside], log.position.value[inside], "made")
            out.append(replace(log, position=place, force=Signal(time, force, "made")))
        return out

    return made


def nothing(record: Record) -> np.ndarray:
    return np.zeros_like(record.velocity)


def found(model: Model, logs: list[Log], *absent: str) -> tuple[str, set[tuple[str, str]]]:
    """The verdict on a model without terms of these types, and the effects with their joints."""
    for term in model.terms:
        if term.type in absent:
            model = model.without_term(term)
    result = diagnose(model, logs[:2], logs[2:], OPTIONS, load_thresholds())
    return result.verdict, {(one.candidate.type, one.candidate.where) for one in result.findings}


def test_of_a_whole_model_nothing_is_claimed(
    model: Model, robot: Callable[[Law], list[Log]]
) -> None:
    verdict, effects = found(model, robot(nothing))
    assert verdict in ("none", "insufficient_data")
    assert not effects


@pytest.mark.parametrize(
    "absent", [("rotor_inertia",), ("coulomb",), ("viscous",), ("coulomb", "viscous")]
)
def test_all_that_is_left_out_is_named_and_nothing_else(
    model: Model, robot: Callable[[Law], list[Log]], absent: tuple[str, ...]
) -> None:
    had = {(term.type, term.only_joint) for term in model.terms if term.type in absent}
    assert found(model, robot(nothing), *absent) == ("named", had)


def test_a_law_of_no_catalogue_on_three_axes_gets_no_name(
    model: Model, robot: Callable[[Law], list[Log]]
) -> None:
    def law(record: Record) -> np.ndarray:
        size = np.array([0.0, 400.0, 300.0, 0.0, 40.0, 0.0])
        detents: np.ndarray = np.sin(25.0 * record.position + 1.0)
        return size * detents

    verdict, effects = found(model, robot(law))
    assert not effects
    assert verdict in ("unknown", "insufficient_data")
