"""A recording played to the identification node gives what the same recursion gives offline."""

import signal
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from integration.recording_graph import LATCHED, Graph, run

from crane_identification import read_bag
from crane_identification.online.estimator import OnlineOptions
from crane_identification.online.replay import replay
from crane_interfaces.msg import ParameterEstimate
from crane_model import load_model
from crane_model.machine_files import machine_file

FORGETTING = 0.9999
TOPICS = ("/joint_states", "/cylinder_pressures")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One period of the simulated crane."""
    path = tmp_path_factory.mktemp("bags") / "one"
    trajectory = machine_file("excitation_20s.yaml")
    run("crane_sim", "make_bag", "--trajectory", trajectory, "--periods", 1, "--out", path)
    return path


def test_a_played_bag_gives_the_estimate_of_the_offline_recursion(ros: Graph, bag: Path) -> None:
    """To 1e-6, values and standard deviations, from the same number of rows."""
    model = load_model(machine_file("model.yaml"))
    log = read_bag(bag, model.joints)
    offline, _ = replay(model, log, OnlineOptions(forgetting=FORGETTING))
    expected = offline.solve()
    assert expected.determined.all()

    estimates: list[ParameterEstimate] = []
    counters: dict[str, str] = {}

    def diagnosed(message: DiagnosticArray) -> None:
        for one in message.status:
            if one.name == "identification: recursion":
                counters.update((entry.key, entry.value) for entry in one.values)

    ros.node.create_subscription(
        ParameterEstimate, "/parameter_estimate", estimates.append, LATCHED
    )
    ros.node.create_subscription(DiagnosticArray, "/diagnostics", diagnosed, 10)
    parameter = f"forgetting:={FORGETTING}"
    node = ros.start(
        "identification", "--ros-args", "-p", parameter, package="crane_identification"
    )
    # slowly: the queues of the node hold ten seconds, and what is later is lost
    given = "--topics", *TOPICS, "--wait-for", *TOPICS, "--rate", "0.5"
    player = ros.start("player", bag, *given)
    ros.wait(lambda: not player.running)
    ros.wait(lambda: counters.get("samples [-]") == str(offline.samples))
    ros.wait(lambda: estimates and estimates[-1].samples == offline.samples)

    estimate = estimates[-1]
    assert list(estimate.name) == [parameter.name for parameter in model.parameters]
    np.testing.assert_allclose(estimate.value, expected.values, rtol=1e-6)
    np.testing.assert_allclose(estimate.std_dev, expected.std_devs, rtol=1e-6)
    assert counters["unmatched [-]"] == str(offline.matcher.unmatched)
    assert node.end(signal.SIGTERM) == 0
