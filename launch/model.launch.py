"""
Show the rig in RViz: its model, moved by what the sensors publish.

    ros2 launch hunt_ros model.launch.py
    ros2 launch hunt_ros model.launch.py namespace:=lab2 urdf:=my_rig.urdf rviz:=false

Beside a suite, or a live replay (use_sim_time:=true). It needs the packages joint_state_publisher,
robot_state_publisher and rviz2, which the suite does not.
"""

from collections.abc import Mapping
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hunt_ros.nodes.support.launching import SWITCH, description

#: Name: default, values (any where there are none), description.
ARGUMENTS = {
    'namespace': ('rig', None, 'ROS namespace of the rig'),
    'urdf': ('', None, 'Model of the rig; empty: config/rig.urdf of the package'),
    'rviz': ('true', SWITCH, 'Open RViz; false: only publish the model, for Foxglove'),
    'use_sim_time': ('false', SWITCH, 'Follow /clock, which a live replay publishes'),
}
_RATE_HZ = 50


def generate_launch_description() -> LaunchDescription:
    """Return the description of the two publishers of the model, and RViz."""
    return description(ARGUMENTS, _nodes)


def _nodes(given: Mapping[str, str]) -> list[Node]:
    """Return the nodes for these values of the arguments."""
    config = Path(get_package_share_directory('hunt_ros')) / 'config'
    urdf = Path(given['urdf'] or config / 'rig.urdf').expanduser()
    if not urdf.is_file():
        raise FileNotFoundError(f'urdf:={urdf}: there is no such file')
    clock = {'use_sim_time': given['use_sim_time'] == 'true'}
    sources = {'source_list': ['lateral', 'yaw', 'roller'], 'rate': _RATE_HZ, **clock}
    text = ParameterValue(urdf.read_text(encoding='utf-8'), value_type=str)
    model = {'robot_description': text, 'publish_frequency': float(_RATE_HZ), **clock}
    nodes = [
        Node(
            package=package,
            executable=package,
            namespace=given['namespace'],
            parameters=[parameters],
            output='screen',
        )
        for package, parameters in (
            ('joint_state_publisher', sources),
            ('robot_state_publisher', model),
        )
    ]
    if given['rviz'] == 'true':
        namespace = given['namespace'].strip('/')
        described = f'/{namespace}/robot_description'.replace('//', '/')
        view = Node(
            package='rviz2',
            executable='rviz2',
            arguments=['-d', str(config / 'rig.rviz')],
            parameters=[clock],
            remappings=[('/rig/robot_description', described)],
            output='screen',
        )
        nodes.append(view)
    return nodes
