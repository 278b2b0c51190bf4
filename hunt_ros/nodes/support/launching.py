"""The arguments of a launch file as a table, and their values given to what makes its nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

#: The values of an argument that is a switch.
SWITCH = ['true', 'false']


def description(
    arguments: Mapping[str, tuple[str, Sequence[str] | None, str]],
    nodes: Callable[[Mapping[str, str]], list[Node]],
) -> LaunchDescription:
    """
    Return what a launch file hands out.

    Parameters
    ----------
    arguments : mapping
        Name: default, values (any where there are none), description.
    nodes : callable
        Makes the nodes, once the values of the arguments are known: name to value.
    """

    def launched(context: LaunchContext) -> list[Node]:
        return nodes({name: LaunchConfiguration(name).perform(context) for name in arguments})

    declared = [
        DeclareLaunchArgument(name, default_value=default, choices=choices, description=words)
        for name, (default, choices, words) in arguments.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=launched)])
