"""What the services of the driver do to a moving crane, and how far its commands go."""

from integration.commander import Commander
from integration.driver_stage import Stage
from integration.faults import SMALLEST, UNHINDERED, ramped, swing


def test_emergency_stop_is_neutral_at_once_and_latched(stage: Stage, hand: Commander) -> None:
    swing(stage, hand, UNHINDERED)
    since = len(stage.valves)
    success, _ = stage.call("emergency_stop")
    assert success
    stage.until(lambda: not stage.valves[-1].enabled)
    slew = [abs(one.commands["slew"]) for one in stage.valves[since:]]
    assert not [one for one in slew if SMALLEST < one < UNHINDERED - SMALLEST], "ramped"
    success, text = stage.call("enable")
    assert not success
    assert text.startswith("not enabled: the state is emergency stop; ")
    assert stage.report()[0] == "emergency stop"
    stage.disabled()


def test_disable_ramps_to_neutral(stage: Stage, hand: Commander) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    assert stage.call("disable") == (True, "disabled")
    ramped(stage, since)


def test_enable_is_refused_while_a_command_is_not_neutral(stage: Stage, hand: Commander) -> None:
    hand.send(slew=0.5)

    def refused() -> bool:
        """By this command; before it has arrived, the one before holds."""
        stage.disabled()
        success, text = stage.call("enable")
        return not success and "the command is slew 0.5; command neutral first" in text

    stage.until(refused)


def test_a_speed_beyond_the_limit_is_reduced(stage: Stage, hand: Commander) -> None:
    """The open spool alone would turn the crane at more than 1 rad/s."""
    fastest = 0.4
    stage.disabled()  # and no longer swinging
    stage.until(lambda: all(abs(state.velocity[0]) < 0.01 for state in stage.states[-200:]))
    side = -1.0 if stage.states[-1].position[0] > 0.0 else 1.0  # where there is way to go
    stage.moving(hand, slew=side * 0.12)
    hand.send(slew=side)
    since = len(stage.states)
    stage.until(lambda: side * stage.states[-1].position[0] > 0.5)
    speeds = [side * state.velocity[0] for state in stage.states[since:]]
    stage.disabled()
    assert max(speeds) <= 1.4 * fastest, "it overshoots while the spool opens"
    assert 0.5 * fastest < speeds[-1] <= 1.05 * fastest


def test_at_a_limit_the_command_goes_no_further(stage: Stage, hand: Commander) -> None:
    """Into the end of the telescope with a fully open spool."""
    end, since = 1.55, len(stage.states)
    stage.moving(hand, telescope=0.12)
    hand.send(telescope=1.0)
    stage.until(lambda: stage.states[-1].position[3] > end - 0.02)
    rest = stage.measured(lambda state: abs(state.velocity[3]) < 0.005)
    assert rest.position[3] <= end + 0.01
    most = max(state.velocity[3] for state in stage.states[since:])
    assert 0.1 < most <= 1.25 * 0.5  # Table 2
    stage.moved(hand, lambda: stage.states[-1].position[3] < end - 0.05, telescope=-0.3)  # and back
