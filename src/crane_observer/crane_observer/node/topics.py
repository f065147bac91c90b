"""Topics of the observers: names, qualities, from messages to readings and back."""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from crane_bags.clocks import NANOSECONDS
from crane_interfaces.msg import PositionEstimate, SensorFindings, TipLoad
from crane_model.array import Array
from crane_nodes.stamps import stamp_of
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.signatures import Part
from crane_observer.position.sensor import Told
from crane_observer.scale.scale import Weighing

JOINT_STATES, PRESSURES, COMMANDS = "joint_states", "cylinder_pressures", "valve_command"
OUTPUTS = "valve_output"
DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def report_message(found: DiagnosticStatus, stamp: Time) -> DiagnosticArray:
    """What a node says of itself."""
    message = DiagnosticArray(status=[found])
    message.header.stamp = stamp
    return message


def picked(joints: Sequence[str], names: Sequence[str], values: Sequence[float]) -> Array:
    """(j,) of `values`, one a name; NaN of joints that are not named."""
    given = dict(zip(names, values, strict=False))
    return np.array([given.get(joint, np.nan) for joint in joints], dtype=float)


def states_message(joints: Sequence[str], told: Told, stamp: int) -> JointState:
    """Position and velocity of the joints of the model."""
    estimate = told.estimate
    message = JointState(
        name=list(joints),
        position=estimate.position.tolist(),
        velocity=estimate.velocity.tolist(),
    )
    message.header.stamp = stamp_of(stamp)
    return message


def estimate_message(joints: Sequence[str], told: Told, stamp: int) -> PositionEstimate:
    """How far they are to be believed."""
    estimate = told.estimate
    deviation = estimate.deviation
    message = PositionEstimate(
        name=list(joints),
        position=estimate.position.tolist(),
        velocity=estimate.velocity.tolist(),
        std_dev=deviation[:-1].tolist(),
        measured=told.measured.tolist(),
        observable=told.observable.tolist(),
        covariance=estimate.covariance.ravel().tolist(),
        load=estimate.load,
        load_std_dev=float(deviation[-1]),
        condition=told.condition.name,
    )
    message.header.stamp = stamp_of(stamp)
    return message


def findings_message(findings: Sequence[SensorFinding], zero: int) -> SensorFindings:
    """All of them; their times count from `zero` [ns]."""

    message = SensorFindings(
        sensor=[one.sensor for one in findings],
        joint=[_joint(one) for one in findings],
        kind=[str(one.kind) for one in findings],
        unit=[one.unit for one in findings],
        size=[one.size for one in findings],
        low=[one.low for one in findings],
        high=[one.high for one in findings],
        onset=[zero / NANOSECONDS + one.onset for one in findings],
        dangerous=[one.dangerous for one in findings],
        what_to_do=[one.what_to_do for one in findings],
    )
    if findings:
        newest = max(one.found for one in findings)
        message.header.stamp = stamp_of(zero + round(newest * NANOSECONDS))
    return message


def _joint(finding: SensorFinding) -> str:
    """Whose position is in doubt, of a supply that may be an encoder."""
    if finding.rival is not None:
        return finding.rival.joint
    return "" if finding.part is Part.SUPPLY else finding.joint


def load_message(weighing: Weighing, zero: int) -> TipLoad:
    """What hangs at the tip; its time counts from `zero` [ns]."""
    load = weighing.load
    message = TipLoad(
        load=load.mass,
        std_dev=load.deviation,
        centre=load.centre,
        centre_std_dev=load.centre_deviation,
        moved=weighing.moved,
        changed=weighing.changed,
        condition=weighing.condition.name,
    )
    message.header.stamp = stamp_of(zero + round(weighing.time * NANOSECONDS))
    return message
