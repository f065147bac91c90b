"""The tuning as parameters: of the controller file, or given singly, also while running."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.parameters import declare, given
from crane_trajectory.control.controller import load_gains
from crane_trajectory.control.tuning import Tuning
from crane_trajectory.trajectory_parameters import CONTROLLER, CONTROLLER_FILE, TuningNumbers


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
