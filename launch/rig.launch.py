"""
Launch the suite: sensors, speed, detector, recorder, identifier; the simulator if wanted.

    ros2 launch hunt_ros rig.launch.py
    ros2 launch hunt_ros rig.launch.py simulated:=false params:=my_rig.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

NODES = (
    'lateral_sensor',
    'yaw_sensor',
    'roller_speed',
    'hunting_detector',
    'bag_recorder',
    'normal_form_identifier',
)


def generate_launch_description() -> LaunchDescription:
    """Return the description of the whole suite under one namespace."""
    default = Path(get_package_share_directory('hunt_ros')) / 'config' / 'rig.yaml'
    arguments = [
        DeclareLaunchArgument('namespace', default_value='rig', description='ROS namespace'),
        DeclareLaunchArgument(
            'params', default_value=str(default), description='Parameter file of the rig'
        ),
        DeclareLaunchArgument(
            'simulated', default_value='true', description='Start the rig simulator'
        ),
        DeclareLaunchArgument('use_sim_time', default_value='false', description='Follow /clock'),
    ]
    common = {
        'package': 'hunt_ros',
        'namespace': LaunchConfiguration('namespace'),
        'parameters': [
            LaunchConfiguration('params'),
            {'use_sim_time': LaunchConfiguration('use_sim_time')},
        ],
        'output': 'screen',
    }
    simulator = Node(
        executable='rig_simulator',
        condition=IfCondition(LaunchConfiguration('simulated')),
        **common,
    )
    return LaunchDescription(
        [*arguments, simulator, *(Node(executable=n, **common) for n in NODES)]
    )
