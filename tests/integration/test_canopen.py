"""A CANopen device on the driver's bus: started, lost, reset."""

from collections.abc import Callable, Iterator

import pytest
from integration.canopen_device import CanopenDevice
from integration.commander import Commander
from integration.driver_stage import Stage
from integration.faults import swing

NODE, NAME = 5, "boom_encoder"
DEVICES = {NAME: {"id": NODE, "heartbeat_timeout": 1.0, "heartbeat_period": 0.1,
                  "emergency": "fault"}}  # fmt: skip


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(tmp_path_factory.mktemp("driver"), [], canopen=DEVICES)
    yield one
    one.close()


@pytest.fixture(scope="module")
def encoder(stage: Stage) -> Iterator[CanopenDevice]:
    device = CanopenDevice(stage, NODE)
    yield device
    device.close()


def shown(stage: Stage) -> tuple[bytes, str]:
    stage.report()
    level, text, _ = stage.diagnostics[f"driver: {NAME}"]
    return level, text


def test_without_the_device_the_crane_cannot_be_enabled(stage: Stage) -> None:
    state, _ = stage.report()
    assert state == "offline"
    success, text = stage.call("enable")
    assert not success
    assert "the state is offline; not all messages and devices of the machine" in text
    level, text = shown(stage)
    assert level == b"\x02"
    assert text.startswith("not heard yet")


def test_a_device_that_boots_is_told_its_heartbeat_and_started(
    stage: Stage, encoder: CanopenDevice
) -> None:
    encoder.boot()
    stage.until(lambda: encoder.state == "OPERATIONAL")
    assert encoder.heartbeat_period == 100  # ms
    stage.until(lambda: shown(stage) == (b"\x00", "operational"))
    stage.disabled()


@pytest.mark.parametrize(
    ("trouble", "name", "detail"),
    [
        (CanopenDevice.fall_silent, "heartbeat", "none for 1"),
        (CanopenDevice.boot, "reboot", "boot-up message in operation"),
        (CanopenDevice.stop, "not operational", "state stopped (0x04), it was operational"),
        (
            CanopenDevice.report_emergency,
            "emergency",
            "Code 0x5000, Device Hardware, register 0x01, data 2a",
        ),
    ],
)
def test_trouble_in_operation_ramps_to_neutral_is_latched_and_can_be_reset(
    trouble: Callable[[CanopenDevice], None],
    name: str,
    detail: str,
    stage: Stage,
    encoder: CanopenDevice,
    hand: Commander,
) -> None:
    swing(stage, hand)
    since = len(stage.valves)
    trouble(encoder)
    stage.until(lambda: not stage.valves[-1].enabled)
    values = [abs(one.commands["slew"]) for one in stage.valves[since:]]
    assert len([one for one in values if 1e-3 < one < 0.49]) >= 4, "not at once"
    assert values[-1] == 0.0
    state, faults = stage.report()
    assert state.startswith("fault")
    assert detail in faults[f"{name} {NAME}"]
    if trouble is CanopenDevice.fall_silent:
        encoder.boot()  # the driver leaves it alone until the fault is reset
    stage.disabled()  # started again meanwhile, where that was needed
    assert encoder.state == "OPERATIONAL"
