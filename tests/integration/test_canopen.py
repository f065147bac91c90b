"""A CANopen device of the `canopen` library on the driver's bus: started, lost, reset."""

from collections.abc import Callable, Iterator

import canopen
import pytest
from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.datatypes import UNSIGNED16
from integration.commander import Commander
from integration.driver_stage import Stage, commander

from crane_driver.can.bus import BusSettings, open_bus

pytestmark = pytest.mark.realtime

NODE, NAME = 5, "boom_encoder"
DEVICES = {NAME: {"id": NODE, "heartbeat_timeout": 1.0, "heartbeat_period": 0.1,
                  "emergency": "fault"}}  # fmt: skip


class Encoder:
    """A device that makes heartbeats only when it is told to, as they come from the factory."""

    def __init__(self, port: int):
        dictionary = ObjectDictionary()
        period = ODVariable("Producer heartbeat time", 0x1017)
        period.data_type, period.default = UNSIGNED16, 0
        dictionary.add_object(period)
        self._network = canopen.Network(open_bus(BusSettings(extra={"port": port})))
        self._network.connect()
        self.node = self._network.create_node(NODE, dictionary)

    def boot(self) -> None:
        self.node.sdo[0x1017].raw = 0
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"

    def close(self) -> None:
        self.node.nmt.stop_heartbeat()
        self._network.disconnect()


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(tmp_path_factory.mktemp("driver"), [], canopen=DEVICES)
    yield one
    one.close()


@pytest.fixture(scope="module")
def encoder(stage: Stage) -> Iterator[Encoder]:
    device = Encoder(stage.port)
    yield device
    device.close()


@pytest.fixture(scope="module")
def hand(stage: Stage) -> Iterator[Commander]:
    with commander(stage) as process:
        yield process


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
    stage: Stage, encoder: Encoder
) -> None:
    encoder.boot()
    stage.until(lambda: encoder.node.nmt.state == "OPERATIONAL")
    assert encoder.node.sdo[0x1017].raw == 100  # ms
    stage.until(lambda: shown(stage) == (b"\x00", "operational"))
    stage.disabled()


def lost(encoder: Encoder) -> None:
    encoder.node.nmt.stop_heartbeat()


def rebooted(encoder: Encoder) -> None:
    encoder.boot()


def stopped(encoder: Encoder) -> None:
    encoder.node.nmt.state = "STOPPED"


def emergency(encoder: Encoder) -> None:
    encoder.node.emcy.send(0x5000, 0x01, b"\x2a")
    encoder.node.emcy.reset()


@pytest.mark.parametrize(
    ("trouble", "name", "detail"),
    [
        (lost, "heartbeat", "none for 1"),
        (rebooted, "reboot", "boot-up message in operation"),
        (stopped, "not operational", "state stopped (0x04), it was operational"),
        (emergency, "emergency", "Code 0x5000, Device Hardware, register 0x01, data 2a"),
    ],
)
def test_trouble_in_operation_ramps_to_neutral_is_latched_and_can_be_reset(
    trouble: Callable[[Encoder], None],
    name: str,
    detail: str,
    stage: Stage,
    encoder: Encoder,
    hand: Commander,
) -> None:
    stage.moving(hand, slew=0.5)
    since = len(stage.valves)
    trouble(encoder)
    stage.until(lambda: not stage.valves[-1].enabled)
    values = [one.commands["slew"] for one in stage.valves[since:]]
    assert len([one for one in values if 1e-3 < one < 0.49]) >= 4, "not at once"
    assert values[-1] == 0.0
    state, faults = stage.report()
    assert state.startswith("fault")
    assert detail in faults[f"{name} {NAME}"]
    if trouble is lost:
        encoder.boot()  # the driver leaves it alone until the fault is reset
    stage.disabled()  # started again meanwhile, where that was needed
    assert encoder.node.nmt.state == "OPERATIONAL"
