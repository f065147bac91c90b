"""jog in a terminal of its own, beside driver and simulated crane: what reaches the valves."""

import math
import re
import signal
import subprocess
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from integration.driver_stage import Stage, made
from integration.jogging import JOG, SLOW_TO_END, Terminal, enable, hold, jogging
from integration.processes import PATIENCE, environment, line
from sensor_msgs.msg import Joy

from crane_interfaces.msg import ValveCommand

HOLD = 0.12  # s, that a character holds its joint
STOP = 0.15  # s after the last character: ramp and period added
SLACK = 0.15  # s, for bus, driver and this test
MOVING = 0.08  # a valve command that moves the simulated crane
DEAD_BAND, RISE = 0.05, 0.25 / 0.3  # of jog by default: valve command, and per second
LATE = 0.02  # s, of a stamp after the time for which its command was made
DEADMAN, INNER_BOOM = 4, 4  # button and axis by default
BOOM = 1  # place of the inner boom in /joint_states


def ready(stage: Stage, terminal: Terminal) -> float:
    """Enabled, and at rest; where the inner boom stands [rad]."""
    if not stage.valves[-1].enabled:
        enable(stage, terminal)
    rest = stage.measured(lambda state: abs(state.velocity[BOOM]) < 1e-3)
    return float(rest.position[BOOM])


def neutral(stage: Stage) -> bool:
    return stage.valves[-1].commands["inner_boom"] == 0.0


def commands(stage: Stage, since: int) -> list[tuple[float, float]]:
    return [(one.steady, one.commands["inner_boom"]) for one in stage.valves[since:]]


def moves(stage: Stage, since: int) -> bool:
    return any(value > MOVING for _, value in commands(stage, since))


def last_moved(stage: Stage, since: int) -> float:
    """When the valve was last open; -inf if it was not."""
    return max((time for time, value in commands(stage, since) if value), default=-math.inf)


def set_in_motion(stage: Stage, terminal: Terminal) -> None:
    """The inner boom moves, by a key typed just now."""
    ready(stage, terminal)
    hold(stage, terminal, "k", 0.3)
    assert not neutral(stage)


def flat(text: str) -> str:
    """What was shown, without the ends of lines."""
    return " ".join(text.split())


@pytest.fixture
def terminal(stage: Stage) -> Iterator[Terminal]:
    """jog by keyboard."""
    with jogging(stage) as one:
        yield one


def test_a_held_key_raises_the_inner_boom_and_letting_go_stops_it(
    stage: Stage, terminal: Terminal
) -> None:
    sent: list[ValveCommand] = []
    stage.listen(ValveCommand, "/valve_command", sent.append)
    start, since = ready(stage, terminal), len(stage.valves)
    last = hold(stage, terminal, "k", 1.0)
    stage.until(lambda: neutral(stage))
    assert 0.0 < last_moved(stage, since) - last < STOP + SLACK
    assert ready(stage, terminal) > start + 0.02
    assert moves(stage, since)
    assert min(value for _, value in commands(stage, since)) >= 0.0
    told = [(made(one), one.command[one.name.index("inner_boom")]) for one in sent]
    for (before, a), (now, b) in pairwise(told):
        step = RISE * (now - before + LATE) + (DEAD_BAND if a == 0.0 else 0.0)
        assert b - a < step, "ramped"


def test_a_tap_is_a_nudge(stage: Stage, terminal: Terminal) -> None:
    start, since = ready(stage, terminal), len(stage.valves)
    terminal.type("j")
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] < -MOVING)
    stage.until(lambda: neutral(stage))
    moved = [time for time, value in commands(stage, since) if value]
    assert moved[-1] - moved[0] < STOP + SLACK
    assert -0.03 < ready(stage, terminal) - start < 0.0


def test_another_key_stops_it_at_once(stage: Stage, terminal: Terminal) -> None:
    ready(stage, terminal)
    hold(stage, terminal, "k", 0.3)
    since = len(stage.valves)
    terminal.type("k")
    stage.until(lambda: moves(stage, since))
    terminal.type(" ")
    typed = stage.now
    stage.until(lambda: neutral(stage))
    assert last_moved(stage, since) - typed < HOLD


def test_the_line_shows_state_joint_and_position(stage: Stage, terminal: Terminal) -> None:
    shown = re.compile(r"enabled +slew +\+0\.00 .* rad +speed 3")
    stage.until(lambda: shown.search(terminal.text))
    terminal.type("d")
    stage.until(lambda: "disable: disabled" in terminal.text)


def test_a_refusal_names_the_key_to_press(stage: Stage, terminal: Terminal) -> None:
    terminal.type("x")
    stage.until(lambda: stage.safety[0].startswith("emergency stop"))
    terminal.type("e")
    stage.until(lambda: re.search(r"not enabled: .*then press r\b", flat(terminal.text)))


def test_a_signal_ends_it_at_neutral_and_restores_the_terminal(
    stage: Stage, terminal: Terminal
) -> None:
    assert terminal.settings != terminal.before, "keys come at once"
    set_in_motion(stage, terminal)
    terminal.process.send_signal(signal.SIGTERM)
    stage.until(lambda: terminal.process.poll() is not None)
    assert terminal.process.returncode == 0
    assert terminal.settings == terminal.before
    stage.until(lambda: neutral(stage))
    assert "command timeout" not in stage.report()[1]


def test_a_terminal_that_is_slow_to_end_holds_no_valve_open(stage: Stage, tmp_path: Path) -> None:
    free = tmp_path / "free"
    slow = SLOW_TO_END.format(free=str(free)) + JOG
    with jogging(stage, program=slow) as terminal:
        set_in_motion(stage, terminal)
        terminal.process.send_signal(signal.SIGTERM)
        stage.until(lambda: neutral(stage) or not stage.valves[-1].enabled)
        assert stage.report()[0] == "enabled"
        assert terminal.process.poll() is None, "it is at its terminal still"
        free.touch()
        stage.until(lambda: terminal.process.poll() is not None)


def test_a_joystick_moves_while_its_deadman_button_is_held(stage: Stage) -> None:
    publisher = stage.node.create_publisher(Joy, "/joy", 1)

    def push(value: float, button: int, seconds: float) -> None:
        until = stage.now + seconds
        axes, buttons = [0.0] * 6, [0] * 6
        axes[INNER_BOOM], buttons[DEADMAN] = value, button
        while stage.now < until:
            publisher.publish(Joy(axes=axes, buttons=buttons))
            stage.within(lambda: False, 0.02)

    with jogging(stage, "--joy") as terminal:
        stage.until(publisher.get_subscription_count)
        for button, centred in ((0, True), (1, False)):  # neither is enough
            ready(stage, terminal)
            since = len(stage.valves)
            push(0.0, button if centred else 0, 0.2)
            push(1.0, button, 0.4)
            assert not moves(stage, since)

        def drive() -> None:
            ready(stage, terminal)
            push(0.0, 1, 0.2)
            push(1.0, 1, 0.4)
            assert not neutral(stage)

        drive()
        push(1.0, 0, 0.1)
        stage.until(lambda: neutral(stage))
        drive()
        silent, since = stage.now, len(stage.valves)
        stage.until(lambda: neutral(stage))
        assert 0.0 < last_moved(stage, since) - silent < 0.1 + STOP + SLACK
        assert "command timeout" not in stage.report()[1]
    stage.node.destroy_publisher(publisher)


def test_without_a_terminal_it_is_refused(stage: Stage) -> None:
    done = subprocess.run(
        line(JOG), stdin=subprocess.DEVNULL, capture_output=True, text=True, env=environment(),
        timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("error: keys are read from a terminal, but standard input is")


def test_a_jog_that_is_killed_is_a_fault_and_the_valves_ramp_to_neutral(stage: Stage) -> None:
    with jogging(stage) as terminal:
        set_in_motion(stage, terminal)
        since = len(stage.valves)
        terminal.process.kill()
        stage.until(lambda: not stage.valves[-1].enabled)  # others notice after 20 s
    values = [value for _, value in commands(stage, since)]
    assert values[-1] == 0.0
    state, faults = stage.report()
    assert state.startswith("fault") and "command timeout" in faults
    assert len([one for one in values if 0.0 < one < values[0]]) >= 2  # not at once
