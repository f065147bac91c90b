"""The suite on simulated time as processes, and the signals that its bags hold."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
import rclpy
import yaml
from integration.processes import RUN, end, environment, free_port, line
from mcap.reader import make_reader
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from crane_bags import typestore
from crane_bags.types import (
    CYLINDER_PRESSURES,
    GENERALIZED_FORCES,
    JOINT_REFERENCE,
    JOINT_STATES,
    PARAMETER_ESTIMATE,
    VALVE_COMMAND,
    VALVE_OUTPUT,
    double_fields,
)
from crane_interfaces.msg import ValveCommand
from crane_nodes import DriverClient, this_computer
from crane_nodes.executor import KeptExecutor
from crane_nodes.node_time import nanoseconds

PATIENCE = 900.0  # s, bounds a failing test
SIMULATED = ("-p", "use_sim_time:=true")
LISTENERS = ("trajectory", "identification", "recorder")
MODULES = {
    "crane": "crane_sim.simulated_crane",
    "driver": "crane_driver.driver_node",
    "trajectory": "crane_trajectory.trajectory_node",
    "identification": "crane_identification.online.identification_node",
    "recorder": "crane_nodes.recording.recorder_node",
    "excitation": "crane_trajectory.run_excitation_node",
}
SIGNALS = (
    *(JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, VALVE_OUTPUT, JOINT_REFERENCE),
    *(GENERALIZED_FORCES, PARAMETER_ESTIMATE),
)
TRAJECTORY = {
    "name": "short",
    "period": 5.0,
    "joints": {
        "inner_boom": {"offset": 0.35, "sine": [0.06], "cosine": [0.02]},
        "outer_boom": {"offset": -1.5, "sine": [0.0, 0.06], "cosine": [0.1, 0.0]},
        "telescope": {"offset": 0.4, "sine": [0.1], "cosine": [0.05]},
    },
}
SHORT_PATIENCE = (
    "import crane_nodes.this_computer; crane_nodes.this_computer.PATIENCE_S = 8.0; " + RUN
)


class Suite:
    """One recorded experiment on simulated time within a `with` block."""

    def __init__(self, folder: Path, seed: int, program: str = RUN):
        folder.mkdir()
        self._folder, self._seed, self._program = folder, seed, program
        self._environment = environment() | this_computer.patient_variables(os.environ, folder)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=int(os.environ["ROS_DOMAIN_ID"]))
        simulated = Parameter("use_sim_time", value=True)
        self.node = Node("watcher", context=self._context, parameter_overrides=[simulated])
        self._executor = KeptExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.driver = DriverClient(self.node)
        self.time = 0  # ns, simulated
        self.commanded = False  # whether the newest command moves a joint
        self.node.create_subscription(Clock, "/clock", self._ticked, 1)
        self.node.create_subscription(ValveCommand, "/valve_command", self._command, 1)

    def __enter__(self) -> Self:
        try:
            self._begin()
        except AssertionError:
            self.__exit__()
            raise
        return self

    def _begin(self) -> None:
        trajectory = self._folder / "short.yaml"
        trajectory.write_text(yaml.safe_dump(TRAJECTORY))
        port = free_port()
        seed = str(self._seed)
        self._start("crane", "--lock-step", "--bus-option", f"port={port}", "--seed", seed)
        listeners = f"simulated_time.listeners:={' '.join(LISTENERS)}"
        self._start("driver", "--ros-args", "-p", f"bus.options:=port={port}", "-p", listeners)
        self._start("trajectory", "--ros-args")
        self._start("identification", "--ros-args")
        self._start("recorder", "--out", str(self.bag), "--ros-args")
        self.until(lambda: self.driver.state.text == "disabled")
        self._start(
            *("excitation", "--enable", "--trajectory", str(trajectory), "--periods", "1"),
            *("--result", str(self._folder / "result.json"), "--ros-args"),
        )

    def __exit__(self, *_: object) -> None:
        if excitation := self.processes.get("excitation"):
            excitation.kill()  # it may wait for one that was killed
        for name in reversed(self.processes):
            end(self.processes[name], signal.SIGINT)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    @property
    def bag(self) -> Path:
        return self._folder / "bag"

    def _start(self, name: str, *arguments: str) -> None:
        clock = () if name == "crane" else SIMULATED
        with (self._folder / f"{name}.log").open("wb") as log:
            self.processes[name] = subprocess.Popen(
                line(self._program.format(module=MODULES[name]), *arguments, *clock),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
            )

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; {self.logs()}"
            self._executor.spin_once(timeout_sec=0.05)

    def moved_on(self, seconds: float) -> None:
        """Wait until simulated time has gone on by this."""
        then = self.time + round(seconds * 1e9)
        self.until(lambda: self.time > then)

    def completed(self) -> None:
        """Wait for the end of the experiment, and of what is recorded of it."""
        self.until(lambda: self.processes["excitation"].poll() is not None)
        assert self.processes["excitation"].returncode == 0, self.logs()
        self.until(lambda: self.driver.state.text == "disabled")

    def logs(self) -> str:
        """What all processes have printed last."""
        said = {name: (self._folder / f"{name}.log").read_text() for name in self.processes}
        return "\n".join(f"{name}: {text[-500:]}" for name, text in said.items())

    def _command(self, message: ValveCommand) -> None:
        self.commanded = any(message.command)

    def _ticked(self, message: Clock) -> None:
        self.time = nanoseconds(message.clock)


Signals = dict[str, dict[str, np.ndarray]]


def signals(bag: Path) -> Signals:
    """By topic and field, `stamp` among them: what was measured, commanded and estimated.

    In the order of the bag, whenever a message was recorded.
    """
    store = typestore()
    columns: dict[str, dict[str, list[Any]]] = {
        topic.name: {name: [] for name in ("stamp", *double_fields(store, topic.msgtype))}
        for topic in SIGNALS
    }
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            for schema, channel, recorded in make_reader(file).iter_messages(list(columns)):
                assert schema
                message: Any = store.deserialize_cdr(recorded.data, schema.name)
                stamp = message.header.stamp
                for name, column in columns[channel.topic].items():
                    told = stamp.sec * 10**9 + stamp.nanosec if name == "stamp" else None
                    column.append(getattr(message, name) if told is None else told)
    return {
        topic: {name: np.array(column) for name, column in fields.items()}
        for topic, fields in columns.items()
    }


def assert_same(one: Signals, two: Signals) -> None:
    """The same to the last bit.

    Bags may begin and end at other times: the recorder finds the publishers as their processes
    start, and is ended when the crane has come to rest.
    """
    for topic, fields in one.items():
        stamps = fields["stamp"], two[topic]["stamp"]
        begin = max(values[0] for values in stamps)
        end = min(values[-1] for values in stamps)
        rows = [(begin <= values) & (values <= end) for values in stamps]
        assert rows[0].mean() > 0.9, topic
        for name, values in fields.items():
            left, right = values[rows[0]], two[topic][name][rows[1]]
            assert left.tobytes() == right.tobytes(), f"{topic} {name}"
