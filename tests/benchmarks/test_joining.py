"""How long the middleware alone holds up a publisher when a node joins: rclpy, nothing of ours."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("joining_node.py")
NEWCOMER = "newcomer"
JOINED = 4  # times
THERE, STAYS = 25.0, 2.0  # s


def begin(own: str, others: list[str], seconds: float) -> subprocess.Popen[str]:
    """Until it talks."""
    arguments = [sys.executable, str(PROGRAM), own, ",".join(others), f"{seconds}"]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


@pytest.mark.parametrize("count", [1, 3, 7])
def test_a_node_that_joins_holds_up_others(
    count: int, ros_domain: int, measured: Callable[..., None]
) -> None:
    names = [f"n{k}" for k in range(count)]
    nodes = [begin(name, [*names, NEWCOMER], THERE) for name in names]
    newcomers = []
    for _ in range(JOINED):
        newcomers.append(begin(NEWCOMER, names, STAYS))
        newcomers[-1].wait()
    longest = [float(node.communicate()[0]) for node in nodes]
    measured(
        f"rclpy alone, nodes that talk when another joins {JOINED} times: {count}; longest publish",
        "",
        "{longest:.0f} ms",
        longest=max(longest),
    )
    assert all(process.wait() == 0 for process in (*nodes, *newcomers))
