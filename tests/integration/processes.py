"""Driver and simulated crane as processes that tests start and end."""

import os
import signal
import socket
import subprocess
import sys

PATIENCE = 120.0  # s, bounds a failing test; a passing one ends with its condition
# For tests in real time, which a busy computer delays: limits of the driver on frames and commands.
TIMING = {"late": 200, "missing": 300, "lost": 2}
COMMAND_TIMEOUT = 0.6  # s

# Of SCHED_FIFO, in real time, where that is permitted; the driver's is 50.
MACHINE_PRIORITY, CONTROLLER_PRIORITY = 60, 40

RUN = "import sys; from {module} import main; sys.exit(main(sys.argv[1:]))"
# The process gets its priority when it is imported: an import would hold up a crane that moves.
URGENT = """
import os, sys
from contextlib import suppress
from {module} import main
with suppress(PermissionError):
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))
sys.exit(main(sys.argv[1:]))
"""
# Precedes a program whose simulated time soon goes on without a process that was stopped.
IMPATIENT = "import crane_nodes.this_computer; crane_nodes.this_computer.PATIENCE_S = 5.0\n"
DRIVER = RUN.format(module="crane_driver.driver_node")
MACHINE = RUN.format(module="crane_sim.simulated_crane")
URGENT_MACHINE = URGENT.format(module="crane_sim.simulated_crane", priority=MACHINE_PRIORITY)
SIMULATED_TIME = ("-p", "use_sim_time:=true")


def prefer(process: int, priority: int) -> bool:
    """Give another process, by its id, a priority of SCHED_FIFO; return whether that is permitted.

    Threads that it starts later have it, too.
    """
    try:
        os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(priority))
    except (PermissionError, ProcessLookupError):
        return False
    return True


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


def line(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", program, *arguments]


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


def start(program: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        line(program, *arguments),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
    )


def end(process: subprocess.Popen[str], number: int = signal.SIGTERM) -> int:
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.send_signal(number)
    try:
        return process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()
