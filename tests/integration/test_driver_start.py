"""A driver that is given what it cannot work with."""

import pytest

from crane_driver.driver_node import main


@pytest.mark.parametrize(
    ("parameter", "reason"),
    [
        ("bus.bitrate:=-5", "parameter 'bus.bitrate': must be from 0 to 1e+06 bit/s, got -5"),
        ("jerk_density.slew:=0", "parameter 'jerk_density.slew': must be from 1e-09 to 1e+06 "),
        ("bus.interface:=carrier_pigeon", "carrier_pigeon"),
        ("machine:=absent.yaml", "absent.yaml: no such machine"),
    ],
)
def test_a_driver_that_cannot_start_says_why_and_ends(
    parameter: str, reason: str, ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["--ros-args", "-p", parameter]) == 1
    out, err = capfd.readouterr()
    assert reason in out + err
