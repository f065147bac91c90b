"""Valves from bring-up's ramps: the speed that the identified valve gives is the one measured."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from crane_driver.operator.bringup.estimates import Trace, average, fit_dead_band
from crane_driver.operator.bringup.results import DeadBands, Result
from crane_identification.hydraulics.joint_estimate import with_ramps
from crane_model import DataError, load_machine
from crane_model.cylinders import lever_arm
from crane_model.hydraulics import HydraulicValues

SLEW, BOOM = "slew", "inner_boom"
FORTH, BACK, LAG = (0.11, 0.5), (0.13, 0.4), 0.06  # dead band and gain [rad/s]; s
MACHINE = load_machine()


def bands(repeats: int = 3) -> DeadBands:
    """Of triangles whose motion is integrated by hand, with noise of an encoder."""
    noise = np.random.default_rng(0)
    time = np.arange(0.0, 20.0, 0.005)
    command = 0.3 * np.interp(time, [1.0, 9.0, 17.0], [0.0, 1.0, 0.0])

    def fitted(direction: int, dead_band: float, gain: float):
        late = np.interp(time - LAG, time, command)
        way = np.cumsum(gain * np.maximum(late - dead_band, 0.0)) * 0.005
        read = [way + noise.normal(0.0, 3e-5, len(time)) for _ in range(repeats)]
        return average(
            [fit_dead_band(SLEW, Trace(time, direction * reading, direction * command), direction)
             for reading in read],
            rate=0.0375,
        )  # fmt: skip

    return DeadBands(positive=fitted(1, *FORTH), negative=fitted(-1, *BACK))


def written(folder: Path, joint: str, found: DeadBands) -> Path:
    """As bring-up writes it."""
    content = Result[DeadBands](
        step="dead_band", date="2026-11-23", mapping="m.yaml", protocol={}, results={joint: found}
    )
    (folder / "result.yaml").write_text(yaml.safe_dump(content.plain()))
    return folder / "result.yaml"


def test_the_valve_gives_the_speed_that_was_measured(tmp_path: Path) -> None:
    found = with_ramps(None, written(tmp_path, SLEW, bands()), MACHINE)
    assert "2026-11-23" in found.provenance
    valve = found.joints[SLEW].valve
    cylinder, oil = MACHINE.cylinders[SLEW], MACHINE.hydraulics
    a, b, lever = cylinder.area_a, cylinder.area_b, lever_arm(MACHINE, SLEW, np.zeros(1))[0]
    assert valve.lag.value == pytest.approx(LAG, abs=5e-3)
    drops = (
        a * oil.supply_pressure - b * oil.tank_pressure,
        b * oil.supply_pressure - a * oil.tank_pressure,
    )
    sides = [(valve.dead_band_a, valve.supply_a), (valve.dead_band_b, valve.supply_b)]
    true = [FORTH, BACK] if lever > 0.0 else [BACK, FORTH]
    for (dead_band, edge), drop, (band, gain) in zip(sides, drops, true, strict=True):
        assert dead_band.value == pytest.approx(band, abs=2e-3)
        assert dead_band.std_dev is not None and 0.0 < dead_band.std_dev < 1e-3
        opening = (0.25 - dead_band.value) / (1.0 - dead_band.value)
        speed = edge.value * opening * np.sqrt(drop / (a**3 + b**3)) / abs(lever)
        assert speed == pytest.approx(gain * (0.25 - band), rel=0.01)
        assert edge.std_dev is not None and edge.std_dev > 0.0


def test_what_a_recording_tells_is_kept(tmp_path: Path) -> None:
    path = written(tmp_path, SLEW, bands())
    known = with_ramps(None, path, MACHINE).model_copy(update={"provenance": "a recording"})
    again = with_ramps(known, path, MACHINE)
    assert again.joints == known.joints
    assert again.provenance == "a recording"


def test_a_reason_goes_where_ramps_tell_the_valve(tmp_path: Path) -> None:
    known = HydraulicValues(provenance="a recording", joints={}, unknown={SLEW: "did not move"})
    assert SLEW not in with_ramps(known, written(tmp_path, SLEW, bands()), MACHINE).unknown


def test_a_lever_that_changes_and_a_single_ramp_are_named(tmp_path: Path) -> None:
    found = with_ramps(None, written(tmp_path, BOOM, bands()), MACHINE)
    assert "lever changes" in found.unknown[BOOM] and not found.joints
    once = with_ramps(None, written(tmp_path, SLEW, bands(repeats=1)), MACHINE)
    assert "two repeats" in once.unknown[SLEW]
    bag = HydraulicValues(provenance="a recording", joints={}, unknown={SLEW: "did not move"})
    both = with_ramps(bag, written(tmp_path, SLEW, bands(repeats=1)), MACHINE)
    assert both.unknown[SLEW].startswith("did not move; ") and "two repeats" in both.unknown[SLEW]


def test_ramps_of_another_machine_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no actuator for swing"):
        with_ramps(None, written(tmp_path, "swing", bands()), MACHINE)
