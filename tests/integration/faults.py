"""A crane that turns, ways to make faults while it does, and what is to be seen then."""

import re
from itertools import pairwise

from integration.commander import Commander
from integration.driver_stage import Stage, Valves
from integration.processes import MACHINE

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

# A machine whose valve unit gives back no counter of a command; SIGUSR1 begins and ends that.
DEAF_MACHINE = f"""
import signal
from crane_sim.machine_on_bus import ValveUnit
receive, deaf = ValveUnit.receive, []
signal.signal(signal.SIGUSR1, lambda number, _: deaf.pop() if deaf else deaf.append(number))
def half_deaf(unit, frame):
    accepted = dict(unit.accepted)
    receive(unit, frame)
    if deaf:
        unit.accepted = accepted
ValveUnit.receive = half_deaf
{MACHINE}
"""


def swing(stage: Stage, hand: Commander, opening: float = 0.5) -> None:
    """The crane turns by this opening of the slew's valve towards the middle of its range."""
    side = -1.0 if stage.states[-1].position[0] > 0.0 else 1.0
    stage.moving(hand, slew=opening * side)


def ramped(stage: Stage, since: int, joint: str = "slew") -> list[Valves]:
    """Wait until the valves are closed; assert that they closed by a ramp, and stay closed.

    The ramp is what follows the last rise: limits may have held the crane back and let it go.
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


def seconds_told(pattern: str, said: str) -> float:
    """The time [s] that a fault tells in milliseconds."""
    found = re.search(pattern, said)
    assert found, said
    return float(found[1]) * 1e-3


def fault(stage: Stage, name: str) -> str:
    """The text of the fault `name`, which must be latched."""
    stage.until(lambda: name in stage.safety[1])
    message, values = stage.safety
    assert message.startswith("fault"), message
    return values[name]


def operate(stage: Stage, line: str) -> None:
    """Make or mend a fault at the simulated crane, which must have an operator."""
    assert stage.machine.stdin and stage.machine.stdout
    stage.machine.stdin.write(f"{line}\n")
    stage.machine.stdin.flush()
    next(said for said in stage.machine.stdout if said.startswith(("fault: ", "repaired: ")))


def encoder_frame(stage: Stage) -> Frame:
    """The newest frame of an encoder, as another device would send it."""
    stage.frames.clear()
    identifier = next(one.message.frame_id for one in stage.layout.readings if one.positions)
    stage.until(lambda: [one for one in stage.frames if one.id == identifier])
    return [one for one in stage.frames if one.id == identifier][-1]
