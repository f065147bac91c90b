"""How processes share this computer: priorities on its processors, and its loopback.

All threads of a process get the same priority. To give it only to those that serve the bus would
be of little use: they wait for locks that the threads of the middleware hold, and those would wait
for others. A process asks for it when it is ready: while it imports or compiles, it would keep a
core for itself, and the kernel then stops all that has real-time priority there for 50 ms of every
second.
"""

import ctypes
import math
import os
import resource
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

PATIENCE_S = 60.0
"""Real time for which simulated time waits for a process that is there but does not answer [s]."""

# MCL_ of sys/mman.h. Not MCL_FUTURE: under a limit, memory could not be had later that is there.
MCL_CURRENT, MCL_ONFAULT = 1, 4

DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
MIDDLEWARE = "RMW_IMPLEMENTATION"
FAST_DDS = "rmw_fastrtps"
LEASE_XML = "<discovery_config><leaseDuration><sec>120</sec></leaseDuration></discovery_config>"
"""Time for which a process that does not run stays known; the default of Fast DDS is 20 s."""


def schedule(process: int, policy: int, priority: int = 0) -> None:
    """Give all threads of a process, by its id, a policy; those they start later have it, too.

    `PermissionError` if the system does not allow that.
    """
    for thread in Path(f"/proc/{process}/task").iterdir():
        with suppress(ProcessLookupError):  # it has ended meanwhile
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))


@dataclass(frozen=True)
class RealTimeSettings:
    """Scheduling that the process asks for."""

    priority: int  # of SCHED_FIFO, 1 to 99; 0: the one it has
    lock_memory: bool  # that there is at `begin`, so that it is never read back from a disk


class RealTime:
    """Scheduling of the process from `begin` to `end`; `obtained` and `refused` describe it."""

    def __init__(self, settings: RealTimeSettings):
        self.obtained: list[str] = []
        self.refused: list[str] = []  # with the reason
        self._settings = settings
        self._before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority

    def begin(self) -> Self:
        if self._settings.priority:
            priority = f"priority {self._settings.priority} (SCHED_FIFO)"
            try:
                schedule(os.getpid(), os.SCHED_FIFO, self._settings.priority)
                self.obtained.append(priority)
            except PermissionError:
                limit, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
                self.refused.append(f"{priority}: the limit is {limit} (ulimit -r)")
        if self._settings.lock_memory:
            if ctypes.CDLL(None).mlockall(MCL_CURRENT | MCL_ONFAULT) == 0:
                self.obtained.append("locked memory")
            else:
                limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
                self.refused.append(
                    f"locked memory: the limit is {limit >> 10} KiB, it must be unlimited "
                    "(ulimit -l)"
                )
        return self

    def end(self) -> None:
        """Give back the priority; memory stays locked."""
        schedule(os.getpid(), *self._before)


def give_way() -> None:
    """From now on this thread, and what it starts, has no real-time priority: it computes long."""
    if os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class ProcessorTime(NamedTuple):
    """Processor time of a process so far."""

    computed: float  # s, of all threads
    waited: float = math.nan  # s, that one thread was ready to run and did not; NaN: not known
    priority: int = 0  # real-time priority of that thread; 0: none


class ThreadClock:
    """Measures the `ProcessorTime` of the thread that makes it."""

    def __init__(self) -> None:
        self._file = -1
        with suppress(OSError):  # a kernel without statistics of the scheduler
            thread = Path("/proc/thread-self").readlink()
            self._file = os.open(f"/proc/{thread}/schedstat", os.O_RDONLY)

    def read(self) -> ProcessorTime:
        waited = math.nan
        if self._file >= 0:
            waited = 1e-9 * int(os.pread(self._file, 64, 0).split()[1])
        priority = os.sched_getparam(0).sched_priority
        return ProcessorTime(time.process_time(), waited, priority)

    def close(self) -> None:
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment variables for processes that begin in `environment`, whatever it says of RANGE.

    LOCALHOST would do, but with Fast DDS it shares memory, and a node that joins then holds up
    every publisher (config/this_computer.xml). `scripts/env.sh` sets the same. `FileNotFoundError`
    if the profile is not installed: without it Fast DDS would use all networks.
    """
    from ament_index_python.packages import get_package_share_path  # absent without ROS

    middleware = environment.get(MIDDLEWARE) or f"{FAST_DDS}_cpp"
    own_profile = get_package_share_path("crane_nodes") / "config" / "this_computer.xml"
    profiles = environment.get(PROFILES) or str(own_profile)
    if not middleware.startswith(FAST_DDS) or not profiles.endswith(f"/config/{own_profile.name}"):
        return {MIDDLEWARE: middleware, DISCOVERY_RANGE: "LOCALHOST"}
    own_profile.resolve(strict=True)
    return {MIDDLEWARE: middleware, DISCOVERY_RANGE: "SYSTEM_DEFAULT", PROFILES: str(own_profile)}


def patient_variables(environment: Mapping[str, str], folder: Path) -> dict[str, str]:
    """Environment variables for processes on simulated time, which wait for one another.

    A process that is stopped for half a minute must not lose its connections meanwhile. The profile
    with a longer lease is written to `folder`. The other variables are those of `variables`.
    """
    found = variables(environment)
    if PROFILES in found:
        profile = Path(found[PROFILES]).read_text(encoding="utf-8")
        path = folder.absolute() / "simulated_time.xml"
        path.write_text(profile.replace("<builtin>", f"<builtin>{LEASE_XML}"), encoding="utf-8")
        found[PROFILES] = str(path)
    return found
