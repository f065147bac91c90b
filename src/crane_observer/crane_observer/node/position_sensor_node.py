"""`position_sensor`: positions and the load at the tip as a managed node."""

import time
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from sensor_msgs.msg import JointState

from crane_interfaces.msg import CylinderPressures, PositionEstimate
from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART, run_managed
from crane_nodes.names import full_name
from crane_nodes.parameters import NodeParameter, Number, Numbers, Text, declare, hold
from crane_nodes.polled import Polled
from crane_nodes.ready import say_ready
from crane_observer.node.position_topics import HEARD, Beginning, PositionHearing
from crane_observer.node.topics import (
    DEEP,
    estimate_message,
    report_message,
    states_message,
)
from crane_observer.position.observability import HEAVIEST
from crane_observer.position.sensor import START, PositionSensor, SensorCondition, Told

PUBLISH = 1.0  # s, of diagnostics
VISIT = 0.01  # s between two visits to the queues
SILENCE = 0.5  # s without pressures, after which they are reported as lost

MODEL = Text(
    "model", "", "Model file with hydraulics; empty: model.yaml of the machine. At configure"
)
WITHOUT = Text(
    "without", "", "Joints whose encoders are not to be used, separated by spaces. At configure"
)
POSITION = Numbers(
    "start",
    (),
    "rad or m",
    -100.0,
    100.0,
    "Where the joints of the model are, in its order; empty: by the encoders, and unknown of "
    "joints without. At configure",
)
DEVIATION = Number(
    "start_deviation", START, "rad or m", 1e-5, 1.0, "Standard deviation of start. At configure"
)
HEAVIEST_LOAD = Number(
    "heaviest_load", HEAVIEST, "kg", 1.0, 1e5,
    "What may hang at the tip; where forces ask for more, nothing is to be believed. At configure",
)  # fmt: skip
PARAMETERS: tuple[NodeParameter, ...] = (
    AUTOSTART, MACHINE, MODEL, WITHOUT, POSITION, DEVIATION, HEAVIEST_LOAD,
)  # fmt: skip


class PositionSensorNode(LifecycleNode):
    """Listens to pressures, commands and encoders, and tells where the joints are."""

    def __init__(self) -> None:
        super().__init__("position_sensor")
        declare(self, PARAMETERS, read_only=(AUTOSTART, MACHINE))
        self._begin: Beginning | None = None
        hold(self, PARAMETERS, lambda: "configured" if self._begin else "unconfigured")
        self._queues: list[tuple[int, Polled]] = []
        self._hearing: PositionHearing | None = None
        self._heard = 0.0
        self._told: Told | None = None
        self._states = self.create_lifecycle_publisher(JointState, "joint_states_estimated", DEEP)
        self._estimates = self.create_lifecycle_publisher(
            PositionEstimate, "position_estimate", DEEP
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(VISIT, self._visit, clock=steady)
        self.create_timer(PUBLISH, self._report, clock=steady)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read model and parameters; refused where the model has no hydraulics."""
        try:
            file = machine_file("model.yaml", MACHINE.read(self), MODEL.read(self))
            model = load_model(file)
            without, start = WITHOUT.read(self).split(), POSITION.read(self)
            if unknown := [joint for joint in without if joint not in model.joints]:
                raise ConfigurationError(
                    f"parameter 'without': no joint {', '.join(unknown)}; the model has "
                    f"{', '.join(model.joints)}"
                )
            if start and len(start) != len(model.joints):
                raise ConfigurationError(
                    f"parameter 'start': must have {len(model.joints)} numbers, for "
                    f"{', '.join(model.joints)}; got {len(start)}"
                )
            PositionSensor(model, np.zeros(len(model.joints)))  # refuses what it cannot use
            self._begin = Beginning(
                model,
                np.isin(model.joints, without),
                np.array(start) if start else None,
                DEVIATION.read(self),
                HEAVIEST_LOAD.read(self),
            )
        except CraneError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen, from where the crane is said to be."""
        self._queues = [
            (order, Polled(self, msgtype, topic, qos))
            for order, (topic, msgtype, qos) in enumerate(HEARD)
        ]
        assert self._begin is not None
        self._hearing, self._told = PositionHearing(self._begin), None
        self._heard = time.monotonic()
        say_ready(self)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more; where the crane is has to be found anew."""
        for _, queue in self._queues:
            queue.close()
        self._queues, self._hearing = [], None
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the model."""
        self._begin = None
        return super().on_cleanup(state)

    def _visit(self) -> None:
        if self._hearing is None:
            return
        for topic, queue in self._queues:
            for message, _ in queue.take():
                self._hearing.add(topic, message)
                if isinstance(message, CylinderPressures):
                    self._heard = time.monotonic()
        for stamp, told in self._hearing.take():
            self._tell(stamp, told)

    def _tell(self, stamp: int, told: Told) -> None:
        assert self._begin is not None
        if self._told is None or told.condition is not self._told.condition:
            self.get_logger().info(told.condition.value)
        self._told = told
        joints = self._begin.model.joints
        self._states.publish(states_message(joints, told, stamp))
        self._estimates.publish(estimate_message(joints, told, stamp))

    def _report(self) -> None:
        found = DiagnosticStatus(name=f"{full_name(self)}: positions", level=DiagnosticStatus.OK)
        silent = time.monotonic() - self._heard
        sensor = self._hearing.sensor if self._hearing else None
        if self._begin is None:
            found.message = "not configured"
        elif self._told is None or sensor is None or silent > SILENCE:
            found.level = DiagnosticStatus.WARN
            found.message = SensorCondition.WAITING.value
        else:
            told = self._told
            blind = [
                joint
                for joint, seen in zip(self._begin.model.joints, told.observable, strict=True)
                if not seen
            ]
            found.message = told.condition.value
            if blind:
                found.message += f"; not observable: {', '.join(blind)}"
            if blind or told.condition is not SensorCondition.GOOD:
                found.level = DiagnosticStatus.WARN
            found.values = [
                KeyValue(key="load [kg]", value=f"{told.estimate.load:.1f}"),
                KeyValue(key="load, standard deviation [kg]",
                         value=f"{told.estimate.deviation[-1]:.1f}"),
                KeyValue(key="late [-]", value=str(sensor.late)),
                KeyValue(key="invalid [-]", value=str(sensor.invalid)),
            ]  # fmt: skip
        self._diagnostics.publish(report_message(found, self.get_clock().now().to_msg()))


ABOUT = """Estimates positions, velocities and the load at the tip from cylinder_pressures,
valve_output (without a driver that tells it valve_command, while driver/state lets it through) and
the encoders in joint_states that are left, by a model with hydraulics. Publishes
joint_states_estimated and position_estimate."""


def main(argv: Sequence[str] | None = None) -> int:
    """Estimate positions without encoders."""
    return run_managed("position_sensor", PositionSensorNode, ABOUT, PARAMETERS, argv)
