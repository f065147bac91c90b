"""The parameters of the trajectory node: those read at configure, and the tuning by joint."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_model.configuration import bounds, validate
from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_nodes.joint_notes import load_joint_notes
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART
from crane_nodes.parameters import NodeParameter, Number, Switch, Text, declare, given
from crane_trajectory.control.choice import MAY_LEARN, NAMES, PD_DEAD_ZONE
from crane_trajectory.control.pd_dead_zone import Gains, JointGains, Tuning, load_gains

# The parameters of the trajectory node that are read at configure, and the tuning, by joint.

CONTROLLER_FILE = "controller.yaml"
GAIN_MEANINGS = {  # unit with U for that of the joint, meaning
    "kp": ("1/U", "Command per position error"),
    "kd": ("s/U", "Command per velocity error"),
    "dead_zone_positive": ("-", "F_f: command at which the valve opens upwards"),
    "dead_zone_negative": ("-", "F_f: command at which the valve opens downwards"),
    "standstill_speed": ("U/s", "Speed below which its sign is not trusted"),
    "position_tolerance": ("U", "Error that a crane at rest is left with"),
}
LIVE = ". Changeable while running"

CLEARANCE = Text(
    "clearance",
    "",
    "File of the room that the boom tip keeps; empty: clearance.yaml of the machine. At configure",
)
CONTROLLER = Text(
    "controller",
    "",
    "File of the gains, for each that is not given by itself; empty: controller.yaml of the "
    "machine. At configure",
)
LAW = Text(
    "law",
    PD_DEAD_ZONE,
    f"How the crane is led: {', '.join(NAMES)}. At configure",
)
MODEL = Text(
    "model",
    "",
    "Model file with the identified hydraulics of the machine, for every law but "
    f"{PD_DEAD_ZONE}. At configure",
)
FEEDBACK_SCALE = Number(
    "feedback_scale",
    1.0,
    "-",
    0.05,
    2.0,
    f"Of the gains of every law but {PD_DEAD_ZONE}; tune says what the crane stands. At configure",
)
LEARNING = Switch(
    "learning",
    False,
    f"Learn a periodic motion from period to period, where law is {' or '.join(MAY_LEARN)}. "
    "At configure",
)
LARGEST_TIP_LOAD = Number(
    "largest_tip_load",
    0.0,
    "kg",
    0.0,
    1e5,
    f"Heaviest load of tip_load, as scale tells it, that every law but {PD_DEAD_ZONE} leads the "
    "crane with; 0: tip_load is not listened to. At configure",
)
LEARNT_OUTPUT = Text(
    "learnt_output", "learnt_model.yaml", "Model file that ~/save_learnt writes, replacing it"
)
STATES_TIMEOUT = Number(
    "states_timeout",
    0.06,
    "s",
    0.01,
    1.0,
    "Silence of joint_states after which the crane is brought to rest. At configure",
)
PRIORITY = Number(
    "realtime.priority",
    0,
    "-",
    0,
    99,
    "Real-time priority (SCHED_FIFO) while the node is active, if the system permits it; 0: none. "
    "At configure",
    whole=True,
)
SATURATION = Number("saturation", 1.0, "-", 0.01, 1.0, f"Largest spool command{LIVE}")
FIXED = (
    AUTOSTART, CLEARANCE, CONTROLLER, LAW, MODEL, FEEDBACK_SCALE, LARGEST_TIP_LOAD, LEARNING,
    STATES_TIMEOUT, PRIORITY,
)  # fmt: skip


def _gain(joint: str, unit: str, field: str, default: float) -> Number:
    written, meaning = GAIN_MEANINGS[field]
    lowest, highest = bounds(JointGains, field)
    return Number(
        f"gains.{joint}.{field}",
        default,
        written.replace("U", unit),
        lowest,
        highest,
        f"{meaning}{LIVE}",
    )


class TuningNumbers(NamedTuple):
    """The parameters that may be changed while the crane moves: of each joint, and `SATURATION`."""

    gains: Mapping[str, Mapping[str, Number]]
    tolerances: Mapping[str, Number]

    @classmethod
    def of(cls, machine: Machine, name: str) -> "TuningNumbers":
        """Those of the machine called `name`, with what its files say as defaults."""
        notes = load_joint_notes(machine_file("joints.yaml", name), machine.units)
        gains = load_gains(machine_file(CONTROLLER_FILE, name), machine).model_dump()
        units = machine.units
        return cls(
            {
                joint: {field: _gain(joint, units[joint], field, value) for field, value in fields}
                for joint, fields in ((joint, one.items()) for joint, one in gains.items())
            },
            {
                joint: Number(
                    f"tracking_tolerance.{joint}",
                    note.tracking_tolerance,
                    units[joint],
                    1e-4,
                    2.0,
                    "Distance from the reference at which the crane is brought to rest; a tenth "
                    f"of it where the joint is led by the model{LIVE}",
                )
                for joint, note in notes.items()
            },
        )

    @property
    def single_gains(self) -> tuple[Number, ...]:
        """Every gain of every joint."""
        return tuple(one for fields in self.gains.values() for one in fields.values())

    @property
    def all(self) -> tuple[Number, ...]:
        """All that may be changed."""
        return (SATURATION, *self.tolerances.values(), *self.single_gains)

    def values_of(self, gains: Gains) -> dict[str, float]:
        """The gains by the names of their parameters."""
        return {
            self.gains[joint][field].name: value
            for joint, fields in gains.model_dump().items()
            for field, value in fields.items()
        }

    def tuning(self, values: Mapping[str, Any]) -> Tuning:
        """What `values` by name give; `ConfigurationError` says which is wrong, and why."""
        gains = {
            joint: {field: one.check(values[one.name]) for field, one in fields.items()}
            for joint, fields in self.gains.items()
        }
        return Tuning(
            validate(gains, Gains, "parameters 'gains'").arrays,
            SATURATION.check(values[SATURATION.name]),
            np.array([one.check(values[one.name]) for one in self.tolerances.values()]),
        )


def parameters_of(machine: str = DEFAULT_MACHINE) -> tuple[NodeParameter, ...]:
    """All parameters of the node, with what the files of the machine of this name say."""
    return (MACHINE, *FIXED, LEARNT_OUTPUT, *TuningNumbers.of(load_machine(machine), machine).all)


# The tuning as parameters: of the controller file, or given singly, also while running.


class TuningParameters:
    """Declares the parameters on `node`; `changed` is called whenever somebody has set one.

    A value is refused if the tuning that it would make is.
    """

    def __init__(self, node: Node, machine: Machine, changed: Callable[[], None]):
        self._node, self._changed = node, changed
        self._numbers = TuningNumbers.of(machine, MACHINE.read(node))
        self._gain_names = {one.name for one in self._numbers.single_gains}
        self._single_gains = given(node, self._numbers.single_gains)  # no file changes these
        declare(node, self._numbers.all)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)

    def read(self) -> Tuning:
        """What the parameters make now; `ConfigurationError` says which is wrong, and why."""
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
        return {one.name: self._node.get_parameter(one.name).value for one in self._numbers.all}

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        new = {one.name: one.value for one in parameters}
        try:
            self._numbers.tuning(self._current() | new)
        except CraneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: list[Parameter]) -> None:
        self._single_gains |= {one.name for one in parameters} & self._gain_names
        self._changed()
