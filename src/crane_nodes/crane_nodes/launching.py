"""Common parts of the launch files. It needs `launch` of ROS; no node does."""

from collections.abc import Mapping
from typing import Any

from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

COMMON = {
    "namespace": "Namespace of the nodes, for example left; empty: the root",
    "parameters": "Parameter file (YAML) of the nodes; arguments override it",
    "log_level": "Log level of the nodes: debug, info, warn, error or fatal",
    "enclaves": "Folder of the SROS2 enclaves of the nodes, for example /crane; empty: no option",
    "prefix": "Words before the command of every node, for example 'taskset -c 1'",
}
"""Arguments of every launch file: name and description."""


def declared(arguments: Mapping[str, str]) -> list[DeclareLaunchArgument]:
    """Launch arguments by name and description; empty ones are left to the parameter file."""
    return [
        DeclareLaunchArgument(name, default_value="", description=text)
        for name, text in arguments.items()
    ]


def node(
    package: str,
    executable: str,
    parameters: Mapping[str, tuple[str, type]] = {},
    arguments: tuple[Any, ...] = (),
    only_with: str | None = None,
) -> OpaqueFunction:
    """A node of the suite, with the launch argument and type of each of its `parameters`.

    It is started `only_with` a launch argument that is given and not false, where one is named.
    """

    def started(context: LaunchContext) -> list[Node]:
        def given(argument: str) -> str:
            return LaunchConfiguration(argument).perform(context)

        if only_with is not None and given(only_with) in ("", "false"):
            return []
        values = {
            parameter: ParameterValue(LaunchConfiguration(argument), value_type=kind)
            for parameter, (argument, kind) in parameters.items()
            if given(argument)
        }
        log_level = ["--log-level", level] if (level := given("log_level")) else []
        enclave = ["--enclave", f"{path}/{executable}"] if (path := given("enclaves")) else []
        return [
            Node(
                package=package,
                executable=executable,
                name=executable,  # so that `values` go before what the file says of this name
                namespace=given("namespace"),
                prefix=given("prefix") or None,  # None: that of `ros2 launch --launch-prefix`
                parameters=[
                    values_given for values_given in (given("parameters"), values) if values_given
                ],
                arguments=arguments,
                ros_arguments=[*log_level, *enclave] or None,
                output="screen",
            )
        ]

    return OpaqueFunction(function=started)


def included(package: str, file: str, *arguments: str) -> IncludeLaunchDescription:
    """Another launch file, and the arguments, beside those of all, that are handed on to it."""
    path = PathJoinSubstitution([FindPackageShare(package), "launch", file])
    values = [(name, LaunchConfiguration(name)) for name in (*COMMON, *arguments)]
    return IncludeLaunchDescription(path, launch_arguments=values)
