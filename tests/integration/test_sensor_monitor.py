"""The sensor monitor as a process: a plug is pulled at the simulated crane while it moves."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from integration.driver_stage import LATCHED, Stage, commander
from integration.processes import RUN, end, start
from unit.crane_observer.observed import known

from crane_interfaces.msg import SensorFindings
from crane_model.model_file import save_model

NODE = RUN.format(module="crane_observer.node.sensor_monitor_node")
POSE = ["slew=0", "inner_boom=0.5", "outer_boom=-1.3", "telescope=0.6"]
FAULTY = "outer_boom"


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    made = Stage(tmp_path, POSE, operator=True)
    yield made
    made.close()


@pytest.mark.realtime
def test_an_encoder_that_freezes_in_mid_motion_is_named(tmp_path: Path, stage: Stage) -> None:
    save_model(tmp_path / "model.yaml", known())
    told: list[SensorFindings] = []
    stage.node.create_subscription(SensorFindings, "sensor_findings", told.append, LATCHED)
    process = start(NODE, "--ros-args", "-p", f"model:={tmp_path / 'model.yaml'}")
    diagnosed = "sensor_monitor: sensors"
    try:
        stage.until(lambda: diagnosed in stage.diagnostics or process.poll() is not None)
        assert process.poll() is None
        with commander(stage) as hand:
            stage.moving(hand, outer_boom=-0.25)
            since = len(stage.states)
            stage.until(lambda: len(stage.states) > since + 300)
            assert not any(one.sensor for one in told), "nothing was wrong yet"
            stage.until(lambda: stage.diagnostics[diagnosed][0] == b"\x00")
            assert stage.machine.stdin
            stage.machine.stdin.write(f"fault={FAULTY}.encoder.stuck\n")
            stage.machine.stdin.flush()
            stage.until(lambda: told and told[-1].sensor)
        first = next(one for one in told if one.sensor)
        assert list(first.sensor) == [f"{FAULTY} encoder"]
        assert list(first.dangerous) == [True]
        stage.until(lambda: stage.diagnostics[diagnosed][0] != b"\x00")
    finally:
        assert end(process) == 0


def test_a_model_without_hydraulics_is_refused(tmp_path: Path) -> None:
    save_model(tmp_path / "model.yaml", replace(known(), hydraulics=None))
    process = start(NODE, "--ros-args", "-p", f"model:={tmp_path / 'model.yaml'}")
    assert process.wait(60.0) == 1
