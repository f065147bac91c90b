"""The faults of the driver are the same in the code, in the message and in the manual."""

import re
from pathlib import Path

from from_code import faults
from unit.crane_driver.safety.supervised import CAN_FAULT, Bench
from unit.crane_driver.safety.test_substitution import SUBSTITUTED, degraded

from crane_driver import Fault, FaultKind
from crane_driver.driver_messages import STATE_NUMBERS, driver_state, inactive_state
from crane_driver.safety.supervisor import SafetyState, Supervisor
from crane_interfaces.msg import DriverState

ROOT = Path(__file__).resolve().parents[3]
PAGE = "docs/how_to/troubleshooting.md"
CONSTANT = re.compile(r"uint8 FAULT_(\w+)=(\d+) +# (.+)")


def test_the_message_has_a_constant_for_every_fault_and_says_its_cause() -> None:
    text = (ROOT / "crane_interfaces" / "msg" / "DriverState.msg").read_text("utf-8")
    expected = [(kind.name, str(kind.number), kind.cause) for kind in FaultKind]
    none, *rest = CONSTANT.findall(text)
    assert none[:2] == ("NONE", "0")
    assert rest == expected
    for kind in FaultKind:
        assert getattr(DriverState, f"FAULT_{kind.name}") == kind.number


def test_the_manual_has_the_table_of_faults() -> None:
    ((name, table),) = faults.pages().items()
    assert f"../reference/generated/{name}" in (ROOT / PAGE).read_text("utf-8")
    for kind in FaultKind:
        assert f"| `FAULT_{kind.name}` | {kind.cause} | {kind.remedy} |\n" in table


def test_numbers_are_used_once_and_words_fit_into_a_line() -> None:
    numbers = [kind.number for kind in FaultKind]
    assert len(set(numbers)) == len(numbers)
    assert DriverState.FAULT_NONE not in numbers
    for kind in FaultKind:
        line = Fault(kind, "detail", "EncoderBoom", "121", "encoders of outer_boom").line
        assert line.startswith(f"encoders of outer_boom, EncoderBoom (121): {kind}: detail: valves")
        assert line.endswith(f"{kind.remedy}, then call reset_fault")
        assert len(line) < 200


def test_every_state_has_its_number() -> None:
    assert set(STATE_NUMBERS) == set(SafetyState)
    others = {DriverState.STATE_UNKNOWN, DriverState.STATE_INACTIVE, DriverState.STATE_FINALIZED}
    assert len({*STATE_NUMBERS.values(), *others}) == len(SafetyState) + len(others)


def test_the_message_of_a_fault_tells_the_first_and_counts_the_others() -> None:
    bench = Bench().enabled()
    assert driver_state(bench.it) == DriverState(state=DriverState.STATE_ENABLED, text="enabled")
    bench.it.can_faults([CAN_FAULT, Fault(FaultKind.LATE, "51 ms", "EncoderBoom")], bench.now)
    assert driver_state(bench.it) == DriverState(
        state=DriverState.STATE_FAULT,
        text="fault",
        fault=DriverState.FAULT_CHECKSUM,
        source="EncoderBase",
        further_faults=1,
        cause=str(CAN_FAULT),
        remedy=CAN_FAULT.remedy,
    )


def test_degraded_names_the_joint_and_what_to_do() -> None:
    message = driver_state(degraded(Bench()).it)
    assert (message.state, message.substituted) == (DriverState.STATE_DEGRADED, SUBSTITUTED)
    assert message.cause.startswith(f"{SUBSTITUTED}: the position of a joint is estimated")
    assert "repair its encoder" in message.remedy


def test_every_state_but_enabled_says_why_and_what_to_do() -> None:
    bench = Bench()

    def told(it: Supervisor) -> DriverState:
        message = driver_state(it)
        assert message.text == it.state
        assert bool(message.cause) == bool(message.remedy) == (it.state is not SafetyState.ENABLED)
        return message

    assert told(bench.it).state == DriverState.STATE_OFFLINE
    bench.run(1.0)
    assert told(bench.it).state == DriverState.STATE_DISABLED
    bench.it.enable(bench.now)
    assert told(bench.it).state == DriverState.STATE_ENABLED
    bench.it.emergency_stop()
    assert told(bench.it).state == DriverState.STATE_EMERGENCY_STOP
    bench.it.can_faults([CAN_FAULT], bench.now)
    message = told(bench.it)
    assert (message.state, message.fault) == (
        DriverState.STATE_EMERGENCY_STOP,
        DriverState.FAULT_CHECKSUM,
    )
    assert message.cause.startswith("the emergency stop")
    assert inactive_state("unconfigured").remedy == "activate it"
    assert inactive_state("finalized").state == DriverState.STATE_FINALIZED
