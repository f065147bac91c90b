"""The steps that only listen, on a crane that sinks while its operator takes his time."""

from math import degrees

import numpy as np
import pytest
import yaml

from crane_driver import load_layout
from crane_driver.can.mapping import Mapping
from crane_driver.driver_parameters import driver_parameters
from crane_driver.operator.bringup.bench import Bench, BringupTerminal, Protocol
from crane_driver.operator.bringup.estimates import JointInstant
from crane_driver.operator.bringup.results import Series
from crane_driver.operator.bringup.steps import encoders
from crane_model import load_machine
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_nodes.joint_notes import load_joint_notes
from crane_nodes.managed import Stop

MAPPING, MACHINE = machine_file("can.yaml"), load_machine()
JOINTS = MACHINE.joint_names
START = np.array([3.1, 0.4, -1.2, 0.3])
SINKING = np.array([0.0, -1.14e-4, -2e-5, 0.0])  # rad/s, m/s: 13.7 mrad in two minutes
PERIOD, SPEED = 0.02, 0.05


class Crane:
    """Encoders of a crane that sinks; `exchanged` shows one joint on the encoder of another."""

    joints = JOINTS

    def __init__(self):
        self.samples = []
        self.now, self.position = 1.8e9, START.copy()
        self.exchanged = {}

    def spin(self, seconds, speed=0.0):
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            self.position = self.position + (SINKING + speed) * PERIOD
            shown = self.position.copy()
            for one, other in self.exchanged.items():
                shown[one] = self.position[other]
            shown[:3] = (shown[:3] + np.pi) % (2.0 * np.pi) - np.pi
            self.samples.append(
                JointInstant(self.now, 4.8e-5 * np.round(shown / 4.8e-5), np.zeros(4))
            )

    def record(self, seconds):
        self.samples.clear()
        self.spin(seconds)
        return np.array([one.position for one in self.samples])


class Operator(BringupTerminal):
    """Answers by the true angles, `slow` seconds after each question."""

    def __init__(self, crane, slow):
        super().__init__(Stop(), crane.spin)
        self.crane, self.slow, self.said = crane, slow, []
        self.wrong = []  # joints moved by mistake, one each time

    def say(self, text=""):
        self.said.append(text)

    def ask(self, question):
        if "Measure it again?" in question:
            self.crane.exchanged = {}
            return "yes"
        index = JOINTS.index(question.partition(":")[0])
        self.crane.spin(self.slow)
        if "now move it" in question:
            speed = np.zeros(4)
            speed[self.wrong.pop() if self.wrong else index] = SPEED
            self.crane.spin(0.12 / SPEED, speed)
            self.crane.spin(self.slow)
        now = self.crane.position[index]
        return f"{now if JOINTS[index] == 'telescope' else degrees(now):.4f}"


def measured(tmp_path, crane, operator):
    mapping = load(MAPPING, Mapping)
    bench = Bench(
        crane=crane,
        terminal=operator,
        series=Series(tmp_path),
        mapping=MAPPING,
        driver={one: one.default for one in driver_parameters(MACHINE, "laboratory_crane")},
        positions=mapping.positions,
        layout=load_layout(MACHINE, MAPPING, machine_file("can.dbc")),
        units=MACHINE.units,
        notes=load_joint_notes(machine_file("joints.yaml"), MACHINE.units),
        joints=JOINTS,
        protocol=Protocol(2.0, 0.05, 0.04, 0.25, 0.2, 3, 0.2),
    )
    encoders(bench)
    results = yaml.safe_load((tmp_path / "01_encoders" / "result.yaml").read_text())["results"]
    for joint, one in results.items():
        assert one["sign"] == mapping.positions[joint].sign
        assert one["zero"] == pytest.approx(mapping.positions[joint].zero, abs=1e-4)
        assert one["scale"] == pytest.approx(1.0, abs=2e-3)
    return results


@pytest.mark.parametrize("slow", [0.0, 60.0])
def test_encoders_are_found_however_long_the_operator_takes(tmp_path, slow):
    crane = Crane()
    operator = Operator(crane, slow)
    results = measured(tmp_path, crane, operator)
    for joint, true in zip(JOINTS, SINKING, strict=True):
        assert results[joint]["sinking"] == pytest.approx(true, abs=3e-5)
    reported = [text for text in operator.said if "inner_boom has sunk by -0.014" in text]
    assert bool(reported) == (slow == 60.0)


def test_a_joint_moved_by_mistake_is_named_and_only_this_one_is_measured_again(tmp_path):
    crane = Crane()
    operator = Operator(crane, 60.0)
    operator.wrong = [JOINTS.index("inner_boom")]
    measured(tmp_path, crane, operator)
    refused = [text for text in operator.said if "was moved by" in text]
    assert len(refused) == 1
    assert "inner_boom was moved by +0.12 while slew was measured" in refused[0]


def test_exchanged_encoders_are_found_though_the_crane_sinks(tmp_path):
    crane = Crane()
    crane.exchanged = {1: 2, 2: 1}
    operator = Operator(crane, 60.0)
    measured(tmp_path, crane, operator)
    (refused,) = (text for text in operator.said if "two encoders are exchanged" in text)
    assert "outer_boom was moved by +0.12 while inner_boom was measured" in refused
