"""The parameters and topics of the trajectory node: who controls the crane, and by what."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import CylinderPressures, JointReference, TipLoad, ValveCommand
from crane_model.configuration import bounds, validate
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_model.model_file import Model, load_model, save_model
from crane_nodes.joint_notes import load_joint_notes
from crane_nodes.managed import AUTOSTART, full_name, publishers
from crane_nodes.node_time import NodeTime, nanoseconds
from crane_nodes.parameters import MACHINE, NodeParameter, Number, Switch, Text, declare, given
from crane_trajectory.control.choice import (
    MAY_LEARN,
    NAMES,
    PD_DEAD_BAND,
    Learning,
    controller,
    in_words,
    learning,
    learnt_hydraulics,
    led_by_model,
)
from crane_trajectory.control.controller import (
    ChamberPressures,
    Controller,
    GainArrays,
    Gains,
    JointGains,
    Point,
    SensorReading,
    Tuning,
    Wanted,
    load_gains,
)
from crane_trajectory.control.flow_feedforward import FedLoad, ToldLoad
from crane_trajectory.experiment import Experiment, Outcome
from crane_trajectory.motion.motion import Phase, Target
from crane_trajectory.motion.periodic import PeriodicTrajectory
from crane_trajectory.motion.points import PointsTrajectory

TOPIC = "valve_command"
OLDEST_PRESSURES = 0.05  # s, of those that are shown; older ones are lost
NEWEST = QoSProfile(depth=1)
DERIVATIVES = {"position": "positions", "velocity": "velocities", "acceleration": "accelerations"}
CONTROLLER_FILE = "controller.yaml"
GAIN_MEANINGS = {  # unit with U for that of the joint, meaning
    "kp": ("1/U", "Command per position error"),
    "kd": ("s/U", "Command per velocity error"),
    "dead_band_positive": ("-", "F_f: command at which the valve opens upwards"),
    "dead_band_negative": ("-", "F_f: command at which the valve opens downwards"),
    "standstill_speed": ("U/s", "Speed below which its sign is not trusted"),
    "position_tolerance": ("U", "Position error that is tolerated at rest"),
}
LIVE = ". Changeable while running"

CLEARANCE = Text(
    "clearance", "",
    "File of the clearance of the boom tip; empty: clearance.yaml of the machine. At configure",
)  # fmt: skip
CONTROLLER = Text(
    "controller", "",
    "File of the gains, for each that is not given by itself; empty: controller.yaml of the "
    "machine. At configure",
)  # fmt: skip
LAW = Text("law", PD_DEAD_BAND, f"Controller: {', '.join(NAMES)}. At configure")
MODEL = Text(
    "model", "",
    "Model file with the identified hydraulics, for model-based controllers. At configure",
)  # fmt: skip
FEEDBACK_SCALE = Number(
    "feedback_scale", 1.0, "-", 0.05, 2.0,
    "Scale of the feedback gains of model-based controllers; tune finds what the crane tolerates. "
    "At configure",
)  # fmt: skip
LEARNING = Switch(
    "learning", False,
    f"Learn a periodic motion from period to period, if law is {' or '.join(MAY_LEARN)}. "
    "At configure",
)  # fmt: skip
LARGEST_TIP_LOAD = Number(
    "largest_tip_load", 0.0, "kg", 0.0, 1e5,
    "Largest load of tip_load that a model-based controller uses; 0: tip_load is ignored. "
    "At configure",
)  # fmt: skip
LEARNT_OUTPUT = Text(
    "learnt_output", "learnt_model.yaml", "Model file that ~/save_learnt writes, replacing it"
)
STATES_TIMEOUT = Number(
    "states_timeout", 0.06, "s", 0.01, 1.0,
    "Silence of joint_states after which the crane is brought to rest. At configure",
)  # fmt: skip
PRIORITY = Number(
    "realtime.priority", 0, "-", 0, 99,
    "Real-time priority (SCHED_FIFO) while the node is active, if the system permits it; 0: none. "
    "At configure",
    whole=True,
)  # fmt: skip
SATURATION = Number("saturation", 1.0, "-", 0.01, 1.0, f"Largest valve command{LIVE}")
FIXED = (
    AUTOSTART, CLEARANCE, CONTROLLER, LAW, MODEL, FEEDBACK_SCALE, LARGEST_TIP_LOAD, LEARNING,
    STATES_TIMEOUT, PRIORITY,
)  # fmt: skip


def _gain(joint: str, unit: str, field: str, default: float) -> Number:
    written, meaning = GAIN_MEANINGS[field]
    unit, limits = written.replace("U", unit), bounds(JointGains, field)
    return Number(f"gains.{joint}.{field}", default, unit, *limits, f"{meaning}{LIVE}")


def _tolerance(joint: str, unit: str, default: float) -> Number:
    return Number(
        f"tracking_tolerance.{joint}", default, unit, 1e-4, 2.0,
        "Distance from the reference at which the crane is brought to rest; a tenth of it "
        f"with a model-based controller{LIVE}",
    )  # fmt: skip


class TuningNumbers(NamedTuple):
    """The parameters that may be changed while the crane moves: of each joint, and `SATURATION`."""

    gains: Mapping[str, Mapping[str, Number]]
    tolerances: Mapping[str, Number]

    @classmethod
    def of(cls, machine: Machine, name: str) -> "TuningNumbers":
        """Those of the machine called `name`, with what its files say as defaults."""
        units = machine.units
        notes = load_joint_notes(machine_file("joints.yaml", name), units)
        gains = load_gains(machine_file(CONTROLLER_FILE, name), machine).model_dump()
        return cls(
            {
                joint: {name: _gain(joint, units[joint], name, gain) for name, gain in of.items()}
                for joint, of in gains.items()
            },
            {
                joint: _tolerance(joint, units[joint], note.tracking_tolerance)
                for joint, note in notes.items()
            },
        )

    @property
    def single_gains(self) -> tuple[Number, ...]:
        return tuple(gain for fields in self.gains.values() for gain in fields.values())

    @property
    def all(self) -> tuple[Number, ...]:
        return (SATURATION, *self.tolerances.values(), *self.single_gains)

    def values_of(self, gains: Gains) -> dict[str, float]:
        return {
            self.gains[joint][field].name: value
            for joint, fields in gains.model_dump().items()
            for field, value in fields.items()
        }

    def tuning(self, values: Mapping[str, Any]) -> Tuning:
        """Tuning from `values` by name; `ConfigurationError` names the wrong one and the reason."""
        gains = {
            joint: {field: number.check(values[number.name]) for field, number in fields.items()}
            for joint, fields in self.gains.items()
        }
        return Tuning(
            validate(gains, Gains, "parameters 'gains'").arrays,
            SATURATION.check(values[SATURATION.name]),
            np.array([number.check(values[number.name]) for number in self.tolerances.values()]),
        )


def parameters_of(machine: str = DEFAULT_MACHINE) -> tuple[NodeParameter, ...]:
    """All parameters of the node, with what the files of the machine of this name say."""
    return (MACHINE, *FIXED, LEARNT_OUTPUT, *TuningNumbers.of(load_machine(machine), machine).all)


class TuningParameters:
    """Declares the parameters on `node`; `changed` is called whenever somebody has set one.

    A value is refused if the tuning that it would make is.
    """

    def __init__(self, node: Node, machine: Machine, changed: Callable[[], None]):
        self._node, self._changed = node, changed
        self._numbers = TuningNumbers.of(machine, MACHINE.read(node))
        self._gain_names = {gain.name for gain in self._numbers.single_gains}
        self._single_gains = given(node, self._numbers.single_gains)  # no file changes these
        declare(node, self._numbers.all)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)

    def read(self) -> Tuning:
        """Tuning from the present parameters; `ConfigurationError` names a wrong one."""
        return self._numbers.tuning(self._current())

    def read_file(self, machine: Machine) -> None:
        """Gains of the controller file become the parameters that were not given by themselves."""
        node = self._node
        file = machine_file(CONTROLLER_FILE, MACHINE.read(node), CONTROLLER.read(node))
        read = {
            name: value
            for name, value in self._numbers.values_of(load_gains(file, machine)).items()
            if name not in self._single_gains
        }
        if not read:  # every gain was given by itself; ROS refuses to set nothing
            return
        result = node.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in read.items()]
        )
        self._single_gains -= read.keys()  # it was no user who set them
        if not result.successful:
            raise ConfigurationError(f"{file}: {result.reason}")

    def _current(self) -> dict[str, Any]:
        return {
            number.name: self._node.get_parameter(number.name).value for number in self._numbers.all
        }

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        new = {parameter.name: parameter.value for parameter in parameters}
        try:
            self._numbers.tuning(self._current() | new)
        except CraneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: list[Parameter]) -> None:
        self._single_gains |= {parameter.name for parameter in parameters} & self._gain_names
        self._changed()


class MeasuredJoints(NamedTuple):
    """One joint state: (j,) in the order of the joints that were asked for [SI]."""

    stamp: Time
    position: np.ndarray
    velocity: np.ndarray

    @property
    def seconds(self) -> float:
        return self.stamp.sec + self.stamp.nanosec * 1e-9


def sample(message: JointState, joints: Sequence[str]) -> MeasuredJoints:
    """The `joints` of a joint state; `DataError` if one is missing."""
    names = list(message.name)
    if missing := [joint for joint in joints if joint not in names]:
        raise DataError(
            f"joint states: {', '.join(missing)} missing, {', '.join(joints)} are needed"
        )
    if not len(names) == len(message.position) == len(message.velocity):
        raise DataError("joint states: a position and a velocity are needed for every name")
    places = [names.index(joint) for joint in joints]
    return MeasuredJoints(
        message.header.stamp,
        np.asarray(message.position, dtype=float)[places],
        np.asarray(message.velocity, dtype=float)[places],
    )


def several_sources(node: Node) -> str:
    """Who publishes joint states, if several do, as a player of bags might; else empty."""
    if node.count_publishers("joint_states") < 2:
        return ""
    names, topic = publishers(node, "joint_states"), node.resolve_topic_name("joint_states")
    return f"{', '.join(names)} publish {topic}, only the driver may; stop the others"


def reference_message(target: Target, stamp: Time, joints: Sequence[str]) -> JointReference:
    """A message of joint_reference, for the time of the joint state that it is compared with."""
    message = JointReference(
        name=list(joints),
        position=target.position.tolist(),
        velocity=target.velocity.tolist(),
        acceleration=target.acceleration.tolist(),
    )
    message.header.stamp = stamp
    return message


def points_trajectory(
    message: JointTrajectory, position: Mapping[str, float], now: Time
) -> PointsTrajectory:
    """The motion that a joint trajectory asks for; `ConfigurationError` if it is none.

    If its first point is later than 0 s, it begins where the joints are: `position` [rad, m].
    """
    joints, points = list(message.joint_names), list(message.points)
    if unknown := [joint for joint in joints if joint not in position] or not joints:
        raise ConfigurationError(
            f"joint trajectory: no position of {unknown if joints else 'any joint'}; the crane has "
            f"the joints {', '.join(position)}"
        )
    if nanoseconds(message.header.stamp) > nanoseconds(now):
        raise ConfigurationError("joint trajectory: header.stamp is later than now; leave it 0")
    times = [nanoseconds(point.time_from_start) / 1e9 for point in points]
    given = {
        singular: [list(getattr(point, plural)) for point in points]
        for singular, plural in DERIVATIVES.items()
        if any(len(getattr(point, plural)) for point in points)
    }
    for what, rows in given.items():
        if wrong := [row for row, values in enumerate(rows) if len(values) != len(joints)]:
            raise ConfigurationError(
                f"joint trajectory: point {wrong[0]} has {len(rows[wrong[0]])} values of {what} "
                f"for {len(joints)} joints; give one for each, in every point"
            )
    if times[0] > 0.0:
        times.insert(0, 0.0)
        for what, rows in given.items():
            present = [position[joint] if what == "position" else 0.0 for joint in joints]
            rows.insert(0, present)
    content = {
        "kind": "points",
        "name": "joint trajectory",
        "time": times,
        "joints": {
            joint: {what: [row[i] for row in rows] for what, rows in given.items()}
            for i, joint in enumerate(joints)
        },
    }
    return validate(content, PointsTrajectory, "joint trajectory")


def command_message(command: np.ndarray, stamp: Time, joints: Sequence[str]) -> ValveCommand:
    """A message of valve_command."""
    message = ValveCommand(name=list(joints), command=command.tolist())
    message.header.stamp = stamp
    return message


def feedback_message(experiment: Experiment) -> RunExcitation.Feedback:
    """Feedback message of the experiment."""
    phase = Phase.REST if experiment.target is None else experiment.target.phase
    if phase is Phase.REST:  # before the motion, or after it
        phase = Phase.APPROACH if experiment.elapsed == 0.0 else Phase.STOP
    units = experiment.motion.machine.units
    return RunExcitation.Feedback(
        phase=int(phase),
        elapsed=experiment.elapsed,
        duration=experiment.motion.duration,
        name=list(units),
        unit=list(units.values()),
        tracking_error=experiment.tracking_error.tolist(),
    )


def result_message(
    outcome: Outcome, message: str, units: Mapping[str, str], rms: np.ndarray | None = None
) -> RunExcitation.Result:
    """How a goal has ended; `units` of the joints are those of their machine."""
    rms = np.full(len(units), np.nan) if rms is None else rms
    return RunExcitation.Result(
        outcome=int(outcome),
        message=message,
        name=list(units),
        unit=list(units.values()),
        rms_tracking_error=rms.tolist(),
    )


class Valves:
    """Who commands the valves: `node`, from `open` to `close`, and no other meanwhile."""

    def __init__(self, node: Node, clock: NodeTime, joints: Sequence[str]):
        self._node, self._clock, self._joints = node, clock, joints
        self._publisher: Publisher | None = None

    def open(self) -> None:
        self._publisher = self._node.create_publisher(ValveCommand, TOPIC, self._clock.depth)

    def close(self) -> None:
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None

    def send(self, u: np.ndarray | None) -> None:
        """Valve commands (j,), between -1 and 1; None where there are none to send."""
        if u is not None and self._publisher is not None:
            self._publisher.publish(command_message(u, self._clock.stamp(), self._joints))

    @property
    def rivals(self) -> str:
        """Who else may command the valves, and what to do; empty if nobody does."""
        rivals = [
            publisher
            for publisher in publishers(self._node, TOPIC)
            if publisher != full_name(self._node)
        ]
        if not rivals:
            return ""
        return f"{', '.join(rivals)} may command the valves, only one may; stop it"

    @property
    def unheard(self) -> str:
        """Warning if no node listens to commands; empty if the driver does, or none are sent."""
        if self._publisher is None or self._publisher.get_subscription_count():
            return ""
        return f"no driver listens to {self._publisher.topic_name}"


class Leading:
    """The controller of the crane, the chamber pressures that it is shown, and the load: the
    parameters `law` and `model` of a node, the topics cylinder_pressures and tip_load.
    """

    def __init__(self, node: Node, clock: NodeTime):
        self._node, self._clock = node, clock
        self._joints: tuple[str, ...] = ()
        self._subscriptions: list[Subscription] = []
        self._newest: ChamberPressures | None = None
        self._heard = -np.inf
        self._model: Model | None = None
        self._load: FedLoad | None = None  # where tip_load is to be used
        self._learnt: Learning | None = None
        self._of: PeriodicTrajectory | None = None  # which `_learnt` has learnt
        self.law = PD_DEAD_BAND
        self.controller: Controller | None = None  # (36) with gains that may change

    def configure(self, machine: Machine, gains: GainArrays) -> None:
        """Make the controller, compiled; `ConfigurationError` if what it needs is unknown."""
        self._joints, self.law = machine.joint_names, LAW.read(self._node)
        path = MODEL.read(self._node)
        self._model = load_model(path) if path else None
        scale = FEEDBACK_SCALE.read(self._node)
        made = controller(self.law, machine, gains, self._model, scale)
        if LEARNING.read(self._node):
            learning(self.law, made, period=1.0)  # refused here, not while a goal begins
        heaviest = LARGEST_TIP_LOAD.read(self._node)
        if heaviest and led_by_model(made) is None:
            raise ConfigurationError(
                f"parameter 'largest_tip_load': law {self.law} uses no load, so that tip_load "
                "is of no use to it; use another law, or leave it 0"
            )
        self._load = FedLoad(heaviest) if heaviest else None
        self.controller = None if self.law == PD_DEAD_BAND else made
        self._of = self._learnt = None
        middle = machine.ranges().middle
        rest = Point(middle, np.zeros_like(middle), np.zeros_like(middle))
        made.start(np.zeros_like(middle))
        nothing = ChamberPressures.none(len(middle))
        made.command(
            0.0, SensorReading(middle, np.zeros_like(middle), *nothing), Wanted(rest, rest)
        )

    def tightened(self, tuning: Tuning) -> Tuning:
        """The tuning with the tolerances that the controller allows."""
        return tuning if self.controller is None else tuning.tightened(self.controller.by_model)

    def leader(self, trajectory: PeriodicTrajectory) -> Controller | None:
        """The controller, which learns a periodic trajectory from goal to goal where it is to."""
        once = isinstance(trajectory, PointsTrajectory)
        if self.controller is None or once or not LEARNING.read(self._node):
            return self.controller
        if self._learnt is None or self._of != trajectory:
            self._learnt = learning(self.law, self.controller, trajectory.period)
            self._of = trajectory
        return self._learnt

    @property
    def learnt(self) -> dict[str, str]:
        """Learnt values of an adaptive controller, in words; empty for others."""
        led = led_by_model(self.controller)
        return dict(in_words(led)) if led is not None and led.adaptive else {}

    def save_learnt(self, file: Path) -> None:
        """Write the model with what was learnt; `ConfigurationError` if nothing is."""
        led = led_by_model(self.controller)
        if led is None or not led.adaptive or self._model is None:
            raise ConfigurationError(
                f"nothing to save: law {self.law} learns no dead bands and gains, adaptive_flow "
                "does"
            )
        assert self._model.hydraulics is not None  # `controller` saw to it
        values = learnt_hydraulics(self._model.hydraulics, led)
        save_model(file, replace(self._model, hydraulics=values))

    def listen(self) -> None:
        """To the pressures, where a controller may use them, and to the load, where it is to."""
        listen = self._node.create_subscription
        if self.controller is not None:
            self._subscriptions = [
                listen(CylinderPressures, "cylinder_pressures", self._take, NEWEST)
            ]
        if self._load is not None:  # not latched: a load of before is of no use
            self._subscriptions.append(listen(TipLoad, "tip_load", self._weighed, NEWEST))

    def silence(self) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []
        self._newest = None

    @property
    def load(self) -> dict[str, str]:
        """The load that the controller expects, in words; empty where tip_load is not used."""
        return {"load at the tip [kg]": f"{self._load.mass:.1f}"} if self._load else {}

    def sensed(self, stamp: float) -> ChamberPressures | None:
        """The newest pressures, None where they are too old. The controller expects from now on the
        load that is believed at the `stamp` [s] of a joint state.
        """
        if self._load is not None and (led := led_by_model(self.controller)) is not None:
            led.carry(self._load.at(stamp))
        return self._newest if self._clock.now() - self._heard < OLDEST_PRESSURES else None

    def _take(self, message: CylinderPressures) -> None:
        taken = ChamberPressures.none(len(self._joints))
        chambers = zip(message.name, message.chamber_a, message.chamber_b, strict=False)
        a, b = taken.a.copy(), taken.b.copy()
        for joint, in_a, in_b in chambers:
            if joint in self._joints:
                place = self._joints.index(joint)
                a[place], b[place] = in_a, in_b
        self._newest = ChamberPressures(a, b, message.supply)
        self._heard = self._clock.of(message.header.stamp)

    def _weighed(self, message: TipLoad) -> None:
        assert self._load is not None
        stamp = 1e-9 * nanoseconds(message.header.stamp)
        self._load.tell(ToldLoad(stamp, message.load, message.std_dev, message.condition))
