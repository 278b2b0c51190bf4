"""
Launch the suite: sensors, speed, detector, recorder, identifier; the simulator if wanted.

    ros2 launch hunt_ros rig.launch.py
    ros2 launch hunt_ros rig.launch.py simulated:=false rig:=my_rig.yaml
    ros2 launch hunt_ros rig.launch.py normal_form:=recordings/normal_form.yaml respawn:=true
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hunt_ros.suite import LISTENERS, SIMULATOR, SOURCES

ARGUMENTS = {
    'namespace': ('rig', 'ROS namespace'),
    'rig': ('', 'Parameter file of the rig; empty: config/rig.yaml of the package'),
    'normal_form': ('', 'Parameter file of hunt identify --out; empty: none is known'),
    'simulated': ('true', 'Start the rig simulator'),
    'use_sim_time': ('', 'true: follow /clock; empty: as the parameter file says'),
    'respawn': ('false', 'Start a node again when it ends by itself'),
    'log_level': ('info', 'Least severity that is logged: debug, info, warn, error, fatal'),
}
_RESPAWN_DELAY_S = 2.0


def generate_launch_description() -> LaunchDescription:
    """Return the description of the whole suite under one namespace."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes, now that the values of the arguments are known."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    parameters: list[object] = [_file(given['rig'], 'rig') or str(_default_file())]
    if given['normal_form']:
        parameters.append(_file(given['normal_form'], 'normal_form'))
    if given['use_sim_time']:
        simulated_time = ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)
        parameters.append({'use_sim_time': simulated_time})
    common = {
        'package': 'hunt_ros',
        'namespace': given['namespace'],
        'parameters': parameters,
        'output': 'screen',
        'respawn': LaunchConfiguration('respawn'),
        'respawn_delay': _RESPAWN_DELAY_S,
        'arguments': ['--ros-args', '--log-level', given['log_level']],
    }
    simulator = Node(
        executable=SIMULATOR, condition=IfCondition(LaunchConfiguration('simulated')), **common
    )
    return [simulator, *(Node(executable=name, **common) for name in (*LISTENERS, *SOURCES))]


def _default_file() -> Path:
    return Path(get_package_share_directory('hunt_ros')) / 'config' / 'rig.yaml'


def _file(path: str, argument: str) -> str:
    """Return a path that was given, or ''; launch itself only warns where there is no file."""
    if path and not Path(path).is_file():
        raise FileNotFoundError(f'{argument}:={path}: no such parameter file')
    return path
