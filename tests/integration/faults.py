"""A crane that turns, ways to make faults while it does, and what is to be seen then."""

import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

from integration.commander import Commander
from integration.driver_stage import Stage, Valves
from integration.processes import MACHINE_PRIORITY, end, start

from crane_driver.can.frame import Frame

SMALLEST = 1e-3  # two steps of the spool signal
UNHINDERED = 0.2  # opening of the slew's valve, so far that no limit of Table 2 holds it back

# A driver whose bus is gone, as an adapter that is pulled out, while the file GONE exists.
DRIVER = """
import pathlib, sys
from can.interfaces.udp_multicast import UdpMulticastBus as Bus
gone = pathlib.Path({gone!r})
def mortal(method):
    def call(*arguments, **named):
        if gone.exists():
            raise OSError(19, "No such device")
        return method(*arguments, **named)
    return call
for name in ("__init__", "recv", "send"):
    setattr(Bus, name, mortal(getattr(Bus, name)))
from crane_driver.driver_node import main
sys.exit(main(sys.argv[1:]))
"""

# A machine whose encoders are frozen. It accepts commands until a line comes to its standard input.
PLAYED = f"""
import json, os, sys, threading, time
from pathlib import Path
from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusSettings
from crane_driver.can.codec import MachineCodec
from crane_driver.can.link import Link
from crane_nodes.scheduling import prefer
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
mapping, port, positions = Path(sys.argv[1]), int(sys.argv[2]), json.loads(sys.argv[3])
layout = load_layout(load_machine(), mapping, machine_file("can.dbc"))
codec = MachineCodec(layout)
pressures = dict.fromkeys(layout.pressures, 1e6)
accepted, well = {{}}, {{"valve_unit": "Enabled"}}
deaf = threading.Event()
def listen():
    sys.stdin.readline()
    deaf.set()
threading.Thread(target=listen, daemon=True).start()
prefer(os.getpid(), {MACHINE_PRIORITY})
with Link(BusSettings(extra={{"port": port}})) as link:
    cycle, due = min(codec.cycles.values()), time.monotonic()
    print("begins", flush=True)
    while True:
        time.sleep(max(0.0, due - time.monotonic()))
        due += cycle  # by an even clock, as devices have
        for frame in link.take():
            command = codec.decode(frame)
            if command and command.counter is not None and not deaf.is_set():
                accepted[command.message] = command.counter
        for name in codec.cycles:
            link.send(codec.reading_frame(name, positions, pressures, well, accepted=accepted))
"""


def swing(stage: Stage, hand: Commander, opening: float = 0.5) -> None:
    """The crane turns by this opening of the slew's valve towards the middle of its range."""
    side = -1.0 if stage.states[-1].position[0] > 0.0 else 1.0
    stage.moving(hand, slew=opening * side)


def ramped(stage: Stage, since: int, joint: str = "slew") -> list[Valves]:
    """Wait until the valves are closed; assert that they closed by a ramp, and stay closed.

    The ramp is what follows the last rise: while a busy test machine kept this process from acting,
    the limits may have held the crane back and let it go.
    """
    stage.until(lambda: not stage.valves[-1].enabled)
    closed = len(stage.valves)
    stage.until(lambda: len(stage.valves) > closed + 20)
    frames = stage.valves[since:]
    opened = [abs(one.commands[joint]) for one in frames if one.enabled]
    rises = [i for i, (before, after) in enumerate(pairwise(opened), 1) if after > before]
    falling = opened[rises[-1] if rises else 0 :]
    start = next(i for i, value in enumerate(falling) if value < falling[0] - SMALLEST)
    ramp = falling[start - 1 :]
    assert len(ramp) >= 4, "not at once"
    assert ramp[-1] <= 0.5 * ramp[0]
    assert all(one.commands[joint] == 0.0 for one in stage.valves[closed:])
    return frames


def fault(stage: Stage, name: str) -> str:
    """The text of the fault `name`, which must be latched."""
    stage.until(lambda: name in stage.safety[1])
    message, values = stage.safety
    assert message.startswith("fault"), message
    return values[name]


class Played:
    """A machine that stands still, as a process that is never late."""

    def __init__(self, stage: Stage):
        state = stage.states[-1]
        positions = dict(zip(state.name, state.position, strict=True))
        self.process = start(PLAYED, str(stage.mapping), str(stage.port), json.dumps(positions))
        assert self.process.stdout
        assert self.process.stdout.readline()  # it has begun

    def ignore_commands(self) -> None:
        """Accept no more of them at the valves."""
        assert self.process.stdin
        self.process.stdin.write("\n")
        self.process.stdin.flush()


@contextmanager
def played(stage: Stage) -> Iterator[Played]:
    """A machine in the place of the simulated one."""
    os.kill(stage.machine.pid, signal.SIGSTOP)
    one = Played(stage)
    try:
        yield one
    finally:
        end(one.process)
        os.kill(stage.machine.pid, signal.SIGCONT)


def encoder_frame(stage: Stage) -> Frame:
    """The newest frame of an encoder, as another device would send it."""
    stage.frames.clear()
    identifier = next(one.message.frame_id for one in stage.layout.readings if one.positions)
    stage.until(lambda: [one for one in stage.frames if one.id == identifier])
    return [one for one in stage.frames if one.id == identifier][-1]
