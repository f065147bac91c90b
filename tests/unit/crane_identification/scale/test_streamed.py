"""Recording by recording, least squares gives what it gives on all of them together."""

import json
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.synthetic import AXIS_MODEL, AXIS_THETA, axis_log, axis_model

from crane_identification import ColumnMap, Estimator, Options, fit, identify, read_recording
from crane_identification.scale.summed import fit_streamed
from crane_model import load_model

MAP = """
time: {column: t, unit: s}
joints:
  axis: {position: {column: q, unit: m}, force: {column: f, unit: N}}
"""
OPTIONS = Options(estimator=Estimator.LEAST_SQUARES)


@pytest.fixture
def tables(tmp_path: Path) -> list[Path]:
    """The third at half the rate, so that a filter thins it out half as much."""
    model, paths = axis_model(tmp_path), []
    for seed, step in enumerate((1, 1, 2)):
        log = axis_log(seed, model)
        assert log.force is not None
        values = [log.position.time, log.position.value[:, 0], log.force.value[:, 0]]
        paths.append(tmp_path / f"{seed}.csv")
        table = np.column_stack(values)[::step]
        np.savetxt(paths[-1], table, delimiter=",", header="t,q,f", comments="", fmt="%.10g")
    (tmp_path / "map.yaml").write_text(MAP)
    return paths


def test_the_same_estimate_as_of_all_rows(tables: list[Path], tmp_path: Path) -> None:
    model = axis_model(tmp_path)
    columns = ColumnMap.model_validate(
        {
            "time": {"column": "t", "unit": "s"},
            "joints": {
                "axis": {
                    "position": {"column": "q", "unit": "m"},
                    "force": {"column": "f", "unit": "N"},
                }
            },
        }
    )
    told: list[float] = []
    found = fit_streamed(model, tables, OPTIONS, lambda _, done: told.append(done), columns)
    expected = fit(
        model, [read_recording(table, model.joints, columns) for table in tables], OPTIONS
    )
    np.testing.assert_allclose(found.model.theta, expected.estimate.values, rtol=1e-9)
    assert found.information.rows.sum() == expected.estimate.samples
    assert found.model.std_devs is not None
    ratio = found.model.std_devs / expected.estimate.std_devs
    assert ((ratio > 0.4) & (ratio < 2.5)).all()
    assert told[-1] == 1.0


def test_command(tables: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "model.yaml").write_text(AXIS_MODEL)
    common = ["--model", str(tmp_path / "model.yaml"), "--columns", str(tmp_path / "map.yaml")]
    common += ["--train", *map(str, tables[:1]), "--validate", str(tables[1]), "--stream"]
    assert identify.main([*common, "--out", str(tmp_path / "no")]) == 1
    assert "--stream sums information matrices" in capsys.readouterr().err
    out = tmp_path / "out"
    assert not identify.main([*common, "--estimator", "least_squares", "--out", str(out)])
    assert "from the information of 1 recordings" in load_model(out / "model.yaml").provenance
    np.testing.assert_allclose(load_model(out / "model.yaml").theta, AXIS_THETA, rtol=0.1)
    assert json.loads((out / "summary.json").read_text())["heldout_relative_error"]["axis"] < 0.1
    assert sorted(path.name for path in out.iterdir()) == ["model.yaml", "summary.json"]
