"""What laws follow is read off the rows of any machine, whatever its joints are called."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import MODEL, evidence, normal
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.evidence import Evidence, Run, gather
from crane_identification.diagnosis.residuals import on_rows
from crane_identification.preparation.prepare import prepare
from crane_model import ConfigurationError, Model, Record, load_machine
from crane_model.machine_files import machine_file
from crane_model.terms import Setting
from crane_model.terms.term import Variable

NAMES = {"inner_boom": "main", "outer_boom": "jib", "telescope": "ram"}
FACTOR = 20


@pytest.fixture(scope="module")
def renamed(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """The laboratory crane, whose joints have other names and another order."""
    path: Path = tmp_path_factory.mktemp("machine") / "machine.yaml"
    text = machine_file("machine.yaml").read_text()
    for name, other in NAMES.items():
        text = text.replace(f"name: {name}", f"name: {other}")
    path.write_text(text)
    return Model(
        "renamed", Setting({"ram": "m", "jib": "rad", "main": "rad"}, load_machine(path)), ()
    )


@pytest.fixture(scope="module")
def plain() -> Evidence:
    return gather(crane_model(), prepare(crane_model(), crane_log(3), Options()), FACTOR)


def turned(plain: Evidence, model: Model) -> Evidence:
    """The same rows of the renamed crane."""

    def of(record: Record) -> Record:
        motion = (record.position, record.velocity, record.acceleration)
        return Record(model.joints, record.time, *(one[:, ::-1] for one in motion))

    runs = tuple(replace(run, record=of(run.record)) for run in plain.runs)
    return replace(plain, model=model, runs=runs)


@pytest.mark.parametrize("variable", ["extension of the telescope", "inclination of the telescope"])
def test_booms_are_found_by_what_they_are(
    plain: Evidence, renamed: Model, variable: Variable
) -> None:
    rows = on_rows(variable, turned(plain, renamed), 0)
    np.testing.assert_array_equal(rows, on_rows(variable, plain, 0))
    q = np.concatenate([run.record.position[run.kept] for run in plain.runs])
    expected = q[:, 2] if variable == "extension of the telescope" else q[:, 0] + q[:, 1]
    np.testing.assert_allclose(rows, expected, rtol=1e-12)


def test_an_axis_without_a_machine_has_no_booms() -> None:
    still = np.zeros((600, 1))
    run = Run("axis", 0, Record(MODEL.joints, 0.1 * np.arange(600), still, still, still), still, 1)
    made = evidence(normal(1), normal(2)[:, np.newaxis], runs=[run])
    with pytest.raises(ConfigurationError, match="inclination of the telescope: needs a machine"):
        on_rows("inclination of the telescope", made, 0)
