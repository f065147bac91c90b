"""How long the middleware alone holds up a publisher when a node joins: rclpy, nothing of ours."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from crane_nodes.this_computer import DISCOVERY_RANGE, PROFILES

PROGRAM = Path(__file__).with_name("joining_node.py")
NEWCOMER = "newcomer"
JOINED = 4  # times
THERE, STAYS = 25.0, 2.0  # s
LIMIT = 50.0  # ms, after which the driver finds itself stalled


def begin(own: str, others: list[str], seconds: float) -> subprocess.Popen[str]:
    """Until it talks."""
    arguments = [sys.executable, str(PROGRAM), own, ",".join(others), f"{seconds}"]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


def longest_publish(count: int) -> float:
    """The longest [ms] of any of so many nodes while another joins a few times."""
    names = [f"n{k}" for k in range(count)]
    nodes = [begin(name, [*names, NEWCOMER], THERE) for name in names]
    newcomers = []
    for _ in range(JOINED):
        newcomers.append(begin(NEWCOMER, names, STAYS))
        newcomers[-1].wait()
    longest = max(float(node.communicate()[0]) for node in nodes)
    assert all(process.wait() == 0 for process in (*nodes, *newcomers))
    return longest


@pytest.mark.parametrize("count", [1, 3, 7])
def test_a_node_that_joins_holds_up_others(
    count: int,
    ros_domain: int,
    monkeypatch: pytest.MonkeyPatch,
    measured: Callable[..., None],
) -> None:
    """Where Fast DDS is as it comes."""
    monkeypatch.delenv(PROFILES, raising=False)
    monkeypatch.setenv(DISCOVERY_RANGE, "LOCALHOST")
    measured(
        f"rclpy alone, `LOCALHOST`, nodes: {count}, another joins {JOINED} times; longest publish",
        "",
        "{longest:.0f} ms",
        longest=longest_publish(count),
    )


@pytest.mark.parametrize("count", [1, 3, 7])
def test_none_is_held_up_in_the_suites_shell(
    count: int, ros_domain: int, measured: Callable[..., None]
) -> None:
    assert os.environ[DISCOVERY_RANGE] == "SYSTEM_DEFAULT"
    longest = longest_publish(count)
    measured(
        f"the same in the shell of `scripts/env.sh`, nodes: {count}; longest publish",
        f"{LIMIT:.0f} ms",
        "{longest:.0f} ms",
        longest=longest,
    )
    assert longest < LIMIT
