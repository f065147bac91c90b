"""The load that the scale tells leads the crane, live: crane, driver, scale and trajectory node."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from integration.driver_stage import Stage
from integration.experiments import TRAJECTORY, Experiments
from integration.processes import PATIENCE, RUN, start
from integration.test_following import LARGEST_STEP
from known_crane import write_known_model

from crane_interfaces.msg import TipLoad
from crane_model.machine_files import machine_file
from crane_trajectory import Outcome

PAYLOAD_ESTIMATOR = RUN.format(module="crane_observer.node.payload_estimator_node")
LOAD = 60.0  # kg, which no model knows of
TOLD, LED = "/tip_load", "load at the tip [kg]"
REPORTED = 2.0  # s, in which /diagnostics has the end of a goal


@pytest.fixture
def stage(tmp_path: Path, ros_domain: int) -> Iterator[Stage]:
    """A crane that carries the load."""
    plant = yaml.safe_load(machine_file("simulated_crane.yaml").read_text())
    plant["bodies"]["gripper"]["mass"] += LOAD
    file = tmp_path / "loaded.yaml"
    file.write_text(yaml.safe_dump(plant))
    made = Stage(tmp_path, [], plant=file)
    yield made
    made.close()


class Led(Experiments):
    """What the crane is led with, while goals run."""

    @property
    def load(self) -> float:
        """kg, as the node says."""
        return float(self.stage.diagnostics["trajectory: experiment"][2].get(LED, "nan"))

    def until(self, condition: Callable[[], bool]) -> None:
        """Send goals until it holds: the scale needs motion."""
        while not condition():
            self.ended(Outcome.COMPLETED)
            self.stage.within(condition, REPORTED)


def test_the_crane_is_led_with_the_load_while_the_scale_tells_it(
    tmp_path: Path, stage: Stage
) -> None:
    model = write_known_model(tmp_path / "model.yaml")
    told: list[TipLoad] = []
    stage.node.create_subscription(TipLoad, TOLD, told.append, 10)
    scale = start(PAYLOAD_ESTIMATOR, *stage.ros(model=model))
    given = {"law": "flow_feedforward", "model": model, "largest_tip_load": 150.0}
    parameters = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    crane = Led(stage, tmp_path, *parameters)
    try:
        stage.until(lambda: bool(told))
        crane.until(lambda: abs(crane.load - LOAD) < 3.0)
        assert told[-1].load == pytest.approx(LOAD, abs=3.0)
        stage.end(scale)
        crane.until(lambda: crane.load == 0.0)
        assert crane.largest_step() < LARGEST_STEP
        crane.holds_still()
    finally:
        stage.end(scale)
        stage.end(crane.process)


def test_a_law_without_a_model_refuses_it(ros_domain: int) -> None:
    parameters = "--ros-args", "-p", "largest_tip_load:=150.0", "-p", "autostart:=true"
    assert start(TRAJECTORY, *parameters).wait(PATIENCE) == 1
