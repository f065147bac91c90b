"""Samples of the driver as ROS messages.

Messages of every cycle are made once and filled again: `joint_state`, `cylinder_pressures` and
`valve_output` return the message of their last call, so publish it before the next one.
"""

from collections.abc import Mapping
from functools import cache

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from crane_bags.clocks import NANOSECONDS
from crane_driver.can.bus import BusState
from crane_driver.can.canopen import Node, NodeState
from crane_driver.can.frame import show_id
from crane_driver.can.health import Freshness, MessageStream
from crane_driver.can.link import Link
from crane_driver.driver_loop import DriverLoop, JointSample, PressureSample
from crane_driver.safety.supervisor import SafetyState, Supervisor
from crane_interfaces.msg import CylinderPressures, DriverState, ValveCommand

STATE_NUMBERS = {
    SafetyState.OFFLINE: DriverState.STATE_OFFLINE,
    SafetyState.DISABLED: DriverState.STATE_DISABLED,
    SafetyState.ENABLED: DriverState.STATE_ENABLED,
    SafetyState.DEGRADED: DriverState.STATE_DEGRADED,
    SafetyState.LISTENING: DriverState.STATE_LISTENING,
    SafetyState.FAULT: DriverState.STATE_FAULT,
    SafetyState.ESTOP: DriverState.STATE_EMERGENCY_STOP,
}
FINALIZED = "finalized"  # state of a managed node that has been shut down
STATE_LEVELS = {
    SafetyState.OFFLINE: DiagnosticStatus.WARN,
    SafetyState.DISABLED: DiagnosticStatus.OK,
    SafetyState.ENABLED: DiagnosticStatus.OK,
    SafetyState.DEGRADED: DiagnosticStatus.WARN,
    SafetyState.LISTENING: DiagnosticStatus.OK,
    SafetyState.FAULT: DiagnosticStatus.ERROR,
    SafetyState.ESTOP: DiagnosticStatus.ERROR,
}
FRESHNESS_LEVELS = {
    Freshness.FRESH: (DiagnosticStatus.OK, "comes in time"),
    Freshness.LATE: (DiagnosticStatus.WARN, "late"),
    Freshness.MISSING: (DiagnosticStatus.ERROR, "missing"),
}


def joint_state(sample: JointSample, joints: tuple[str, ...]) -> JointState:
    """The message of joint_states."""
    message = _joint_state(joints)
    _stamp(message.header, sample.stamp)
    message.position = sample.position
    message.velocity = sample.velocity
    message.effort = sample.effort
    return message


def valve_output(stamp: int, sent: Mapping[str, float]) -> ValveCommand:
    """Message of valve_output: commands `sent` to the valves at `stamp` [ns], by whomever."""
    message = _valve_output(tuple(sent))
    _stamp(message.header, stamp)
    message.command = list(sent.values())
    return message


def cylinder_pressures(sample: PressureSample, cylinders: tuple[str, ...]) -> CylinderPressures:
    """The message of cylinder_pressures."""
    message = _cylinder_pressures(cylinders)
    _stamp(message.header, sample.stamp)
    message.chamber_a = sample.chamber_a
    message.chamber_b = sample.chamber_b
    message.supply = sample.supply
    message.tank = sample.tank
    return message


def driver_state(supervisor: Supervisor) -> DriverState:
    """driver/state of an active driver; without stamp and node."""
    fault = supervisor.faults.first
    return DriverState(
        state=STATE_NUMBERS[supervisor.state],
        text=supervisor.state,
        fault=fault.kind.number if fault else DriverState.FAULT_NONE,
        source=fault.source if fault else "",
        further_faults=max(0, len(supervisor.faults) - 1),
        cause=supervisor.cause,
        remedy=supervisor.remedy,
        substituted=supervisor.substituted,
        commands_refused=supervisor.commands.refused,
        last_refusal=supervisor.commands.refusal,
    )


def inactive_state(lifecycle_state: str) -> DriverState:
    """driver/state of a driver that does nothing; without stamp and node."""
    ended = lifecycle_state == FINALIZED
    return DriverState(
        state=DriverState.STATE_FINALIZED if ended else DriverState.STATE_INACTIVE,
        text=lifecycle_state,
        cause=f"the driver is {lifecycle_state}",
        remedy="start it again" if ended else "activate it",
    )


def diagnostics(name: str, loop: DriverLoop, link: Link) -> list[DiagnosticStatus]:
    """/diagnostics: the state of safety, of the bus, of messages and devices that are expected."""
    streams = [_stream(name, stream) for stream in loop.monitor.streams.values()]
    devices = [_device(name, node) for node in loop.devices.nodes]
    return [_safety(name, loop.supervisor), _bus(name, loop, link), *streams, *devices]


def inactive(name: str, lifecycle_state: str) -> DiagnosticStatus:
    """/diagnostics of a driver that does nothing."""
    return _status(f"{name}: safety", DiagnosticStatus.STALE, f"the node is {lifecycle_state}", {})


def _safety(name: str, supervisor: Supervisor) -> DiagnosticStatus:
    fault = supervisor.faults.first
    faults = {
        key: f"{latched.count} times: {latched.fault}" for key, latched in supervisor.faults.items()
    }
    listening = [supervisor.cause] if supervisor.state is SafetyState.LISTENING else []
    text = "; ".join([supervisor.state, *listening, *([supervisor.line(fault)] if fault else ())])
    if len(faults) > 1:
        text += f"; {len(faults) - 1} more, see the values"
    level = STATE_LEVELS[supervisor.state]
    if listening and fault:
        level = DiagnosticStatus.WARN
    if supervisor.limited and level == DiagnosticStatus.OK:
        level = DiagnosticStatus.WARN
        text += f"; {', '.join(supervisor.limited)} held back by joint limits"
    values = {
        "state": supervisor.state,
        "substituted": supervisor.substituted,
        "commands refused": supervisor.commands.refused,
        "last refusal": supervisor.commands.refusal,
        **faults,
    }
    return _status(f"{name}: safety", level, text, values)


def _bus(name: str, loop: DriverLoop, link: Link) -> DiagnosticStatus:
    active = link.state is BusState.ACTIVE
    unknown = loop.codec.unknown
    values = {
        "frames received": link.received,
        "frames dropped": link.dropped,
        "times reopened": link.reopened,
        "cycles incomplete": loop.incomplete,
        "unknown frames": sum(unknown.values()),
        "unknown identifiers": " ".join(
            show_id(*unknown_id) for unknown_id in sorted(unknown)[:20]
        ),
    }
    level = DiagnosticStatus.OK if active else DiagnosticStatus.ERROR
    return _status(f"{name}: bus", level, link.state, values)


def _stream(name: str, stream: MessageStream) -> DiagnosticStatus:
    level, text = FRESHNESS_LEVELS[stream.freshness]
    if not stream.received:
        level, text = DiagnosticStatus.ERROR, "not received yet"
    values = {
        "frames": stream.received,
        "frames refused": stream.refused,
        "frames lost": stream.lost,
        "longest gap [ms]": f"{stream.longest_gap * 1e3:.1f}",
    }
    return _status(f"{name}: {stream.layout.name}", level, text, values)


def _device(name: str, node: Node) -> DiagnosticStatus:
    watch = node.watch
    if watch.state is not NodeState.OPERATIONAL:
        level = DiagnosticStatus.ERROR
    else:
        level = DiagnosticStatus.WARN if watch.active else DiagnosticStatus.OK
    text = "; ".join([watch.state, *filter(None, [node.problem]), *watch.active.values()])
    values = {
        "node id": watch.device.id,
        "state": watch.state,
        "heartbeats": watch.heartbeats,
        "longest gap [ms]": f"{watch.longest_gap * 1e3:.1f}",
        "boot-ups": watch.boots,
        "emergencies": watch.emergencies,
    }
    return _status(f"{name}: {watch.name}", level, text, values)


def _status(name: str, level: bytes, message: str, values: dict[str, object]) -> DiagnosticStatus:
    pairs = [KeyValue(key=str(key), value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(name=name, level=level, message=str(message), values=pairs)


@cache
def _joint_state(joints: tuple[str, ...]) -> JointState:
    return JointState(name=joints)


@cache
def _valve_output(joints: tuple[str, ...]) -> ValveCommand:
    return ValveCommand(name=list(joints))


@cache
def _cylinder_pressures(cylinders: tuple[str, ...]) -> CylinderPressures:
    return CylinderPressures(name=cylinders)


def _stamp(header: Header, time: int) -> None:
    header.stamp.sec, header.stamp.nanosec = divmod(time, NANOSECONDS)
