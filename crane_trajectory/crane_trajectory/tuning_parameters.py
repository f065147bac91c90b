"""The tuning as parameters: of the controller file, or given singly, also while running."""

from collections.abc import Callable

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from crane_model.errors import ConfigurationError, CraneError
from crane_nodes.parameters import declare, given
from crane_trajectory.control.controller import load_gains
from crane_trajectory.control.tuning import Tuning
from crane_trajectory.trajectory_parameters import (
    CHANGEABLE,
    CONTROLLER,
    SINGLE_GAINS,
    current_values,
    tuning,
    values_of,
)

GAIN_NAMES = {one.name for one in SINGLE_GAINS}


class TuningParameters:
    """Declares the parameters on `node`; `changed` is called whenever somebody has set one.

    A value is refused if the tuning that it would make is.
    """

    def __init__(self, node: Node, changed: Callable[[], None]):
        self._node, self._changed = node, changed
        self._single_gains = given(node, SINGLE_GAINS)  # no file changes these
        declare(node, CHANGEABLE)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)

    def read(self) -> Tuning:
        """What the parameters make now; `ConfigurationError` says which is wrong, and why."""
        return tuning(current_values(self._node))

    def read_file(self) -> None:
        """Gains of the controller file become the parameters that were not given by themselves."""
        file = CONTROLLER.read(self._node)
        read = {
            name: value
            for name, value in values_of(load_gains(file or None)).items()
            if name not in self._single_gains
        }
        result = self._node.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in read.items()]
        )
        self._single_gains -= read.keys()  # it was no user who set them
        if not result.successful:
            raise ConfigurationError(f"{file}: {result.reason}" if file else result.reason)

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        new = {one.name: one.value for one in parameters}
        try:
            tuning(current_values(self._node) | new)
        except CraneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: list[Parameter]) -> None:
        self._single_gains |= {one.name for one in parameters} & GAIN_NAMES
        self._changed()
