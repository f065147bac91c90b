"""Real time as users get it, by the limits of their account; or as root, if those cannot be set."""

import configparser
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from crane_driver.driver_parameters import PRIORITY

PROGRAM = """
import os, resource, sys, threading
from crane_nodes.this_computer import RealTime, RealTimeSettings
priority, memory, settings = eval(sys.argv[1])
try:
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # tests may run in the idle class
except PermissionError:
    sys.exit("SKIP: this account may not leave the idle class")
try:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (priority, priority))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (memory, memory))
except ValueError:
    if os.geteuid() != 0:
        sys.exit("SKIP: this account may not have such limits")
else:
    if os.geteuid() == 0:
        os.setresuid(65534, 65534, 65534)
done, threads = threading.Event(), [threading.main_thread()]
def start():
    threads.append(threading.Thread(target=done.wait, daemon=True))
    threads[-1].start()
def show():
    names = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo"}
    found = [one.native_id for one in threads]
    print([(names[os.sched_getscheduler(one)], os.sched_getparam(one).sched_priority)
           for one in found])
start()
it = RealTime(RealTimeSettings(**settings)).begin()
start()
print(it.obtained, it.refused)
show()
print("VmLck:\\t       0" in open("/proc/self/status").read())
it.end()
show()
done.set()
"""
UNLIMITED = -1
SHARE = Path(__file__).resolve().parents[3] / "crane_driver" / "realtime"
ALL = {"priority": 50, "lock_memory": True}
NOTHING = {"priority": 0, "lock_memory": False}
NORMAL = str(3 * [("other", 0)])


def asked(priority: int, memory: int, settings: dict[str, int]) -> list[str]:
    """What an account with these limits [1, bytes] is told, line by line."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, repr((priority, memory, settings))],
        capture_output=True,
        text=True,
        timeout=120.0,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    if "SKIP" in done.stderr:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_every_thread_gets_it_where_the_limits_allow_it_and_gives_it_back() -> None:
    told, given, not_locked, afterwards = asked(60, UNLIMITED, ALL)
    assert told == "['priority 50 (SCHED_FIFO)', 'locked memory'] []"
    assert given == str(3 * [("fifo", 50)])  # also the one that was started later
    assert not_locked == "False"
    assert afterwards == NORMAL


def test_what_is_refused_is_named_with_the_limit() -> None:
    told, given, not_locked, _ = asked(0, 8 << 20, ALL)
    assert told == (
        "[] ['priority 50 (SCHED_FIFO): the limit is 0 (ulimit -r)', "
        "'locked memory: the limit is 8192 KiB, it must be unlimited (ulimit -l)']"
    )
    assert given == NORMAL
    assert not_locked == "True"


def test_nothing_is_asked_for_that_is_not_wanted() -> None:
    told, given, not_locked, _ = asked(0, 0, NOTHING)
    assert told == "[] []"
    assert given == NORMAL
    assert not_locked == "True"


def test_the_limits_file_permits_what_the_driver_asks_for() -> None:
    lines = (SHARE / "crane-realtime.conf").read_text().splitlines()
    limits = {item: value for _, _, item, value in (one.split() for one in lines if one[0] != "#")}
    assert int(limits["rtprio"]) >= PRIORITY.default
    assert limits["memlock"] == "unlimited"


def test_the_unit_permits_what_the_driver_asks_for_and_systemd_understands_it() -> None:
    path = SHARE / "crane-driver.service"
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(path)
    assert unit.getint("Service", "LimitRTPRIO") >= PRIORITY.default
    assert unit["Service"]["LimitMEMLOCK"] == "infinity"
    if not shutil.which("systemd-analyze"):
        pytest.skip("no systemd here: its own check of the unit is left out")
    done = subprocess.run(["systemd-analyze", "verify", path], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
