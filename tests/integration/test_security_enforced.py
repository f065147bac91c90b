"""SROS2 enforced as the page sets it up: what is listed works, nobody else commands the valves.

Needs `ros2 security` and a Fast DDS with its security plugins: ROS as Python packages has neither.
"""

import importlib.util
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml
from from_code.parameter_files import ROOT
from integration.experiments import SHORT, TRAJECTORY
from integration.patient_files import mapping_file, patient_safety
from integration.processes import (
    COMMAND_TIMEOUT,
    DRIVER,
    PATIENCE,
    RUN,
    URGENT_MACHINE,
    end,
    environment,
    free_port,
    line,
)

pytestmark = pytest.mark.realtime

PAGE = (ROOT / "docs/how_to/ros.md").read_text("utf-8")
BEGIN, IN_A_NAMESPACE, LOOK, *_ = re.findall(
    r"```sh\n(.*?)```", PAGE.partition("## Who may command")[2], re.DOTALL
)
RUN_EXCITATION = RUN.format(module="crane_trajectory.run_excitation_node")
ENCLAVES = {"": "/crane", "/left": "/left"}  # by namespace, as on the page
TRIES = 5  # a test machine that is too busy makes true faults
NOT_FOUND = "Node not found|Could not determine the type"  # says ros2
NO_PLUGINS = "doesn't have the security libraries"  # says rmw_fastrtps
COMMANDER = """
import sys, rclpy
from crane_interfaces.msg import ValveCommand
rclpy.init(args=sys.argv)
node = rclpy.create_node(sys.argv[1], enable_rosout=False, start_parameter_services=False)
publisher = node.create_publisher(ValveCommand, sys.argv[2], 10)
print("may publish", flush=True)
heard = 0
while True:
    rclpy.spin_once(node, timeout_sec=0.01)
    publisher.publish(ValveCommand(name=["slew"], command=[0.0]))
    if publisher.get_subscription_count() > heard:
        heard = publisher.get_subscription_count()
        print("is heard", flush=True)
"""
RESET = """
import sys, rclpy
from std_srvs.srv import Trigger
rclpy.init(args=sys.argv)
node = rclpy.create_node("jog", enable_rosout=False, start_parameter_services=False)
client = node.create_client(Trigger, "driver/reset_fault")
client.wait_for_service()
rclpy.spin_until_future_complete(node, client.call_async(Trigger.Request()))
"""


class Process:
    """A process, and all that it has said."""

    def __init__(self, log: Path, program: str, *arguments: str, security: dict[str, str]):
        with log.open("w") as file:
            self.popen = subprocess.Popen(
                line(program, *arguments),
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                text=True,
                env=environment() | security,
            )
        self._log = log

    @property
    def said(self) -> str:
        return self._log.read_text()

    def until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, self.said
            time.sleep(0.05)

    def says(self, text: str) -> None:
        self.until(lambda: text in self.said or self.popen.poll() is not None)
        assert text in self.said, self.said

    def ends(self) -> int:
        self.until(lambda: self.popen.poll() is not None)
        return self.popen.returncode


class Secured:
    """A crane, in a namespace or not, and whoever comes to it."""

    def __init__(self, namespace: str, folder: Path, stack: ExitStack):
        self.namespace, self.folder = namespace, folder
        self._stack = stack
        self._security = {
            "ROS_SECURITY_KEYSTORE": str(folder / "keys"),
            "ROS_SECURITY_ENABLE": "true",
            "ROS_SECURITY_STRATEGY": "Enforce",
        }

    def start(self, name: str, program: str, *own: str, ros: tuple[str, ...] = ()) -> Process:
        """As the page does it: in the enclave and the namespace of the crane."""
        enclave = ["--enclave", f"{ENCLAVES[self.namespace]}/{name}"]
        spaced = ["-r", f"__ns:={self.namespace}"] if self.namespace else []
        return self._start(program, *own, "--ros-args", *enclave, *spaced, *ros)

    def shell(self, commands: str) -> subprocess.CompletedProcess[str]:
        """In a shell as the page has it, there for a crane outside of a namespace.

        Again, where ros2 gave up before it had found the driver.
        """
        commands = commands.replace("/crane/", f"{ENCLAVES[self.namespace]}/")
        commands = commands.replace(" /", f" {self.namespace}/")
        deadline = time.monotonic() + PATIENCE
        while True:
            done = subprocess.run(
                ["bash", "-euc", commands],
                env=environment() | self._security,
                capture_output=True,
                text=True,
                timeout=PATIENCE,
            )
            if not done.returncode or not re.search(NOT_FOUND, done.stdout + done.stderr):
                return done
            assert time.monotonic() < deadline, done.stderr

    def outside(self, program: str, *arguments: str) -> Process:
        """Of somebody who knows nothing of the keys."""
        off = dict.fromkeys(self._security, "")
        return self._start(program, *arguments, security=off)

    def _start(
        self, program: str, *arguments: str, security: dict[str, str] | None = None
    ) -> Process:
        log = self.folder / f"{len(list(self.folder.glob('*.log')))}.log"
        process = Process(log, program, *arguments, security=security or self._security)
        self._stack.callback(end, process.popen, signal.SIGINT)
        return process


def keystore(namespace: str, folder: Path) -> None:
    """By the commands of the page."""
    first, *others = BEGIN.splitlines()
    assert first.startswith("policies=")
    commands = [first, IN_A_NAMESPACE, "policies=left.xml"] if namespace else [first]
    commands += [one for one in others if not one.startswith(("export", "ros2 run"))]
    made = subprocess.run(
        ["bash", "-euc", "\n".join(commands)], cwd=folder, capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr


@pytest.fixture(scope="module", params=ENCLAVES, ids=["alone", "left"])
def crane(
    request: pytest.FixtureRequest, ros_domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Secured]:
    """Simulated crane, driver and trajectory node, where policies are enforced."""
    if not importlib.util.find_spec("sros2"):
        pytest.skip("no ros2 security here: ROS as Python packages comes without it")
    folder = tmp_path_factory.mktemp("secured")
    keystore(request.param, folder)
    with ExitStack() as stack:
        secured = Secured(request.param, folder, stack)
        port = str(free_port())
        driver = secured.start(
            "driver",
            DRIVER,
            ros=(
                *("-p", f"bus.options:=port={port}"),
                *("-p", f"mapping:={mapping_file(folder)}"),
                *("-p", f"safety:={patient_safety(folder)}"),
            ),
        )
        driver.until(lambda: "CAN bus" in driver.said or driver.popen.poll() is not None)
        if NO_PLUGINS in driver.said:
            pytest.skip("this Fast DDS is built without its security plugins")
        secured.outside(URGENT_MACHINE, "--bus-option", f"port={port}")
        driver.says("offline -> disabled")
        trajectory = secured.start(
            "trajectory", TRAJECTORY, ros=("-p", f"states_timeout:={COMMAND_TIMEOUT / 2}")
        )
        trajectory.says("ready: ")
        yield secured


def test_an_experiment_is_completed(crane: Secured) -> None:
    file = crane.folder / "short.yaml"
    file.write_text(yaml.safe_dump(SHORT))
    arguments = ["--trajectory", str(file), "--periods", "1", "--enable"]
    for _ in range(TRIES):
        client = crane.start("run_excitation", RUN_EXCITATION, *arguments)
        if client.ends() == os.EX_OK:
            break
        assert crane.start("jog", RESET).ends() == os.EX_OK
    assert "COMPLETED" in client.said, client.said


def test_who_is_not_listed_reaches_nobody(crane: Secured) -> None:
    """While jog, which comes after, is heard."""
    unlisted = crane.outside(COMMANDER, "unlisted", f"{crane.namespace}/valve_command")
    unlisted.says("may publish")
    jog = crane.start("jog", COMMANDER, "jog", "valve_command")
    jog.says("is heard")
    assert "is heard" not in unlisted.said


@pytest.mark.parametrize("name", ["payload_estimator", "recorder", "panel"])
def test_who_is_listed_to_listen_may_not_command(crane: Secured, name: str) -> None:
    listed = crane.start(name, COMMANDER, name, "valve_command")
    assert listed.ends() != os.EX_OK
    assert "may publish" not in listed.said
    assert "valve_command" in listed.said


def test_who_commands_one_crane_may_not_command_another(crane: Secured) -> None:
    other = "/right/valve_command" if not crane.namespace else "/valve_command"
    jog = crane.start("jog", COMMANDER, "jog", other)
    assert jog.ends() != os.EX_OK
    assert "may publish" not in jog.said


def test_the_ros2_command_looks_by_the_commands_of_the_page(crane: Secured) -> None:
    looked = crane.shell(LOOK)
    assert looked.returncode == 0, looked.stderr
    assert f"node: {crane.namespace}/driver" in looked.stdout
    assert looked.stdout.endswith("active [3]\n")


@pytest.mark.parametrize(
    "command",
    [
        "ros2 param set --no-daemon --spin-time 5 /driver machine laboratory_crane",
        "ros2 topic pub --once /valve_command crane_interfaces/msg/ValveCommand '{}'",
        "ros2 lifecycle set --no-daemon --spin-time 5 /driver deactivate",
        "ros2 service call /driver/enable std_srvs/srv/Trigger",
    ],
)
def test_the_ros2_command_changes_nothing(crane: Secured, command: str) -> None:
    export, *_ = LOOK.splitlines()
    changed = crane.shell(f"{export}\n{command}")
    assert changed.returncode != 0, changed.stdout
    assert "failed to create" in (changed.stdout + changed.stderr).lower()


def test_who_has_no_enclave_does_not_start(crane: Secured) -> None:
    stranger = crane.start("stranger", COMMANDER, "stranger", "valve_command")
    assert stranger.ends() != os.EX_OK
    assert "may publish" not in stranger.said
