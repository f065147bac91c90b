"""The folder of a bring-up: nothing is overwritten, and mappings keep what people wrote in them."""

import pytest
import yaml
from matplotlib.figure import Figure

from crane_driver.can.mapping import Mapping
from crane_driver.operator.bringup.estimates import DeadBandResult, EncoderResult
from crane_driver.operator.bringup.results import Series, copy_changed
from crane_model import DataError
from crane_model.configuration import load
from crane_model.machine_files import machine_file

MAPPING = machine_file("can.yaml")


def test_each_step_has_a_folder_of_its_own(tmp_path):
    series = Series(tmp_path / "new")
    assert series.runs == []
    one = EncoderResult(
        sign=-1, zero=0.123456789, noise=1e-5, resolution=4.8e-5, moved=0.2, sinking=0.0
    )
    for number in (1, 2):
        run = series.write("encoders", MAPPING, {"seconds": 2.0}, {"slew": one}, Figure())
        assert run.name == f"{number:02d}_encoders"
    assert [path.name for path in series.runs] == ["01_encoders", "02_encoders"]
    content = yaml.safe_load((run / "result.yaml").read_text())
    assert content["results"]["slew"]["zero"] == 0.123457
    assert (run / "encoders.png").is_file()


def test_dead_bands_are_the_newest_of_each_joint(tmp_path):
    series = Series(tmp_path)
    with pytest.raises(DataError, match="bringup dead_band"):
        series.dead_bands()

    def band(value):
        one = DeadBandResult(dead_band=value, dead_band_std=1e-3, gain=0.8, lag=0.05, repeats=1)
        return {"positive": one, "negative": one}

    series.write("dead_band", MAPPING, {}, {"slew": band(0.1), "telescope": band(0.2)}, Figure())
    series.write("dead_band", MAPPING, {}, {"slew": band(0.3)}, Figure())
    bands = series.dead_bands()
    assert bands["slew"].positive.dead_band == 0.3
    assert bands["telescope"].negative.dead_band == 0.2


def test_a_changed_mapping_keeps_everything_else(tmp_path):
    target = tmp_path / "mapping.yaml"

    def change(content):
        content["positions"]["slew"]["zero"] = 0.25

    copy_changed(MAPPING, target, change, "01_encoders")
    before, after = load(MAPPING, Mapping), load(target, Mapping)
    assert after.positions["slew"].zero == 0.25
    assert after.positions["slew"].sign == before.positions["slew"].sign
    assert after.model_copy(update={"positions": before.positions}) == before
    comments = [line for line in MAPPING.read_text().splitlines() if line.startswith("#")]
    assert all(line in target.read_text() for line in comments)
    with pytest.raises(FileExistsError):
        copy_changed(MAPPING, target, change, "again")
