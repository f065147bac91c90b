"""jog in a terminal of its own, beside driver and simulated crane: what reaches the valves."""

import re
import signal
import subprocess
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest
from integration.driver_stage import Stage
from integration.jogging import JOG, Terminal, enable, hold, jogging
from integration.processes import environment, line
from sensor_msgs.msg import Joy

pytestmark = pytest.mark.realtime

HOLD = 0.12  # s, that a character holds its joint
STOP = 0.15  # s after the last character: ramp and period added
SLACK = 0.15  # s, that a busy test machine may take beyond
MOVING = 0.08  # a spool command that moves the simulated crane
DEADMAN, INNER_BOOM = 4, 4  # button and axis by default
BOOM = 1  # place of the inner boom in /joint_states


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(tmp_path_factory.mktemp("driver"), [])
    yield one
    one.close()


def at_rest(stage: Stage) -> None:
    stage.until(lambda: abs(stage.states[-1].velocity[BOOM]) < 1e-3)


def flat(text: str) -> str:
    """What was shown, without the ends of lines."""
    return " ".join(text.split())


def commands(stage: Stage, since: int) -> list[tuple[float, float]]:
    return [(one.steady, one.commands["inner_boom"]) for one in stage.valves[since:]]


@pytest.fixture(scope="module")
def terminal(stage: Stage) -> Iterator[Terminal]:
    """jog by keyboard that tests share, until one of them ends it."""
    with jogging(stage) as one:
        yield one


def test_a_held_key_raises_the_inner_boom_and_letting_go_stops_it(
    stage: Stage, terminal: Terminal
) -> None:
    at_rest(stage)
    start, since = stage.states[-1].position[BOOM], len(stage.valves)
    last = hold(stage, terminal, "k", 1.0)
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] == 0.0)
    sent = commands(stage, since)
    stopped = next(time for time, value in reversed(sent) if value) - last
    print(f"valves neutral {stopped * 1e3:.0f} ms after the last character")
    assert stopped < STOP + SLACK
    at_rest(stage)
    assert stage.states[-1].position[BOOM] > start + 0.02
    assert max(value for _, value in sent) > MOVING
    assert min(value for _, value in sent) >= 0.0
    assert max(b - a for (_, a), (_, b) in pairwise(sent)) < 0.06, "ramped"
    assert stage.report()[0].startswith("enabled"), "it ended well"


def test_a_tap_is_a_nudge(stage: Stage, terminal: Terminal) -> None:
    at_rest(stage)
    start, since = stage.states[-1].position[BOOM], len(stage.valves)
    terminal.type("j")
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] < -MOVING)
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] == 0.0)
    moved = [time for time, value in commands(stage, since) if value]
    assert moved[-1] - moved[0] < STOP + SLACK
    at_rest(stage)
    assert -0.03 < stage.states[-1].position[BOOM] - start < 0.0


def test_another_key_stops_it_at_once(stage: Stage, terminal: Terminal) -> None:
    hold(stage, terminal, "k", 0.3)
    terminal.type("k")
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] > MOVING)
    terminal.type(" ")
    typed = time.monotonic()
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] == 0.0)
    assert stage.valves[-1].steady - typed < HOLD


def test_the_line_shows_state_joint_and_position(stage: Stage, terminal: Terminal) -> None:
    stage.until(lambda: re.search(r"enabled +inner_boom \+0\.00 .* rad +speed 3", terminal.text))
    terminal.type("d")
    stage.until(lambda: "disable: disabled" in terminal.text)
    enable(stage, terminal)


def test_a_refusal_names_the_key_to_press(stage: Stage, terminal: Terminal) -> None:
    terminal.type("x")
    stage.until(lambda: stage.safety[0].startswith("emergency stop"))
    terminal.type("e")
    stage.until(lambda: re.search(r"not enabled: .*then press r\b", flat(terminal.text)))
    enable(stage, terminal)


def test_a_signal_ends_it_at_neutral_and_restores_the_terminal(
    stage: Stage, terminal: Terminal
) -> None:
    assert terminal.settings != terminal.before, "keys come at once"
    hold(stage, terminal, "k", 0.5)
    terminal.process.send_signal(signal.SIGTERM)
    stage.until(lambda: terminal.process.poll() is not None)
    assert terminal.process.returncode == 0
    assert terminal.settings == terminal.before
    stage.until(lambda: stage.valves[-1].commands["inner_boom"] == 0.0)
    assert stage.report()[0].startswith("enabled"), "no fault"


def test_a_joystick_moves_while_its_deadman_button_is_held(stage: Stage) -> None:
    publisher = stage.node.create_publisher(Joy, "/joy", 1)

    def push(value: float, button: int, seconds: float) -> None:
        until = time.monotonic() + seconds
        axes, buttons = [0.0] * 6, [0] * 6
        axes[INNER_BOOM], buttons[DEADMAN] = value, button
        while time.monotonic() < until:
            publisher.publish(Joy(axes=axes, buttons=buttons))
            stage.within(lambda: False, 0.02)

    def moves(since: int) -> bool:
        return any(value > MOVING for _, value in commands(stage, since))

    with jogging(stage, "--joy"):
        stage.until(publisher.get_subscription_count)
        for button, centred in ((0, True), (1, False)):  # neither is enough
            since = len(stage.valves)
            push(0.0, button if centred else 0, 0.2)
            push(1.0, button, 0.4)
            assert not moves(since)
        push(0.0, 1, 0.2)
        since = len(stage.valves)
        push(1.0, 1, 0.4)
        assert moves(since)
        push(1.0, 0, 0.1)
        stage.until(lambda: stage.valves[-1].commands["inner_boom"] == 0.0)
        push(0.0, 1, 0.2)
        push(1.0, 1, 0.4)
        silent = time.monotonic()
        stage.until(lambda: stage.valves[-1].commands["inner_boom"] == 0.0)
        assert stage.valves[-1].steady - silent < 0.1 + STOP + SLACK
        assert stage.report()[0].startswith("enabled")
    stage.node.destroy_publisher(publisher)


def test_without_a_terminal_it_is_refused(stage: Stage) -> None:
    done = subprocess.run(
        line(JOG), stdin=subprocess.DEVNULL, capture_output=True, text=True, env=environment(),
        timeout=30.0, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("error: keys are read from a terminal, but standard input is")


def test_a_jog_that_is_killed_is_a_fault_and_the_valves_ramp_to_neutral(stage: Stage) -> None:
    with jogging(stage) as terminal:
        hold(stage, terminal, "k", 0.5)
        since = len(stage.valves)
        terminal.process.kill()
        stage.until(lambda: not stage.valves[-1].enabled)
    values = [value for _, value in commands(stage, since)]
    assert values[-1] == 0.0
    assert len([one for one in values if 0.0 < one < values[0]]) >= 2, "not at once"
    state, faults = stage.report()
    assert state.startswith("fault")
    assert "command timeout" in faults
