"""
Launch the suite: sensors, speed, detector, recorder, identifier; the simulator if wanted.

    ros2 launch hunt_ros rig.launch.py
    ros2 launch hunt_ros rig.launch.py simulated:=false rig:=my_rig.yaml respawn:=true
    ros2 launch hunt_ros rig.launch.py sensors:=false one_process:=true
"""

from collections.abc import Mapping
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from hunt_ros.drivers.alarm_output import AlarmSettings
from hunt_ros.drivers.safety_state import state_file
from hunt_ros.rig import Rig, parameters_of, told_by
from hunt_ros.suite import (
    ALARM_OUTPUTS,
    DRIVE,
    GUARDS,
    LISTENERS,
    NODES,
    PAGE,
    SIMULATOR,
    SUITE,
    sources_of,
)

#: The values of an argument that is a switch.
SWITCH = ['true', 'false']
#: Name: default, values (any where there are none), description.
ARGUMENTS = {
    'namespace': ('rig', None, 'ROS namespace'),
    'rig': ('', None, 'Parameter file of the rig; empty: config/rig.yaml of the package'),
    'normal_form': (
        '',
        None,
        'Parameter file of hunt identify --out; empty: the newest in the folder of the recordings',
    ),
    'simulated': ('true', SWITCH, 'Start the rig simulator'),
    'sensors': ('true', SWITCH, 'Start the nodes that talk to the rig; false: yours do'),
    'page': ('false', SWITCH, 'Serve the page of the operator at http://127.0.0.1:8088/'),
    'one_process': (
        'false',
        SWITCH,
        'All but the guards in one process; they fail together',
    ),
    'use_sim_time': ('', ['', *SWITCH], 'Follow /clock; empty: as the parameter file says'),
    'respawn': (
        'false',
        SWITCH,
        'Start a process again when it ends by itself; the guards of a real rig always are',
    ),
    'log_level': (
        'info',
        ['debug', 'info', 'warn', 'error', 'fatal'],
        'Least severity that is logged',
    ),
}
_RESPAWN_DELAY_S = 2.0
#: What a simulated rig does after the end is nobody's concern; a real one gets so long.
_WAY_DOWN_S = '130'


def generate_launch_description() -> LaunchDescription:
    """Return the description of the whole suite under one namespace."""

    def launched(context: LaunchContext) -> list[Node]:
        return _nodes({name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS})

    declared = [
        DeclareLaunchArgument(name, default_value=default, choices=choices, description=words)
        for name, (default, choices, words) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=launched)])


def _nodes(given: Mapping[str, str]) -> list[Node]:
    """Return the nodes for these values of the arguments."""
    file = _rig_file(given['rig'])
    text = Path(file).read_text(encoding='utf-8')
    rig = told_by(Rig(), '', [(file, text)])
    parameters: list[object] = [file]
    if given['normal_form']:
        parameters.append(_file(given['normal_form'], 'normal_form'))
    if given['use_sim_time']:
        parameters.append({'use_sim_time': given['use_sim_time'] == 'true'})
    common = {
        'package': 'hunt_ros',
        'namespace': given['namespace'],
        'parameters': parameters,
        'output': 'screen',
        'respawn': given['respawn'] == 'true',
        'respawn_delay': _RESPAWN_DELAY_S,
    }
    level = ['--ros-args', '--log-level', given['log_level']]
    where = given['namespace'].strip('/')
    simulated = given['sensors'] == given['simulated'] == 'true'
    folder = parameters_of('bag_recorder', text, file).get('directory', 'recordings')
    sources = sources_of(rig.channels) if given['sensors'] == 'true' else ()
    alarms = AlarmSettings.told([(file, text)])
    wanted = {*LISTENERS, *sources, *[ALARM_OUTPUTS] * bool(alarms), *[SIMULATOR] * simulated}
    wanted |= {PAGE} if given['page'] == 'true' else set()
    names = [name for name in NODES if name in wanted]
    together = [name for name in names if name not in (*GUARDS, PAGE)]

    def alone(name: str) -> Node:
        """Return a node in a process of its own: under SROS2 it has the key of its enclave."""
        own = dict(common)
        if name in GUARDS and not simulated:  # gone it leaves the roller as it was
            own['respawn'] = True
        if name == DRIVE:  # the way down to the safe speed takes its time
            own |= dict.fromkeys(('sigterm_timeout', 'sigkill_timeout'), _WAY_DOWN_S)
            # A simulated rig is a new one each time: nothing of the one before is in force.
            kept = {'state_file': str(state_file(Path(folder), where))}
            own['parameters'] = [*parameters, {'slow_down_at_end': False} if simulated else kept]
        return Node(executable=name, arguments=[*level, '--enclave', f'/{where}/{name}'], **own)

    if given['one_process'] == 'true':
        guards, page = ([name for name in names if name in one] for one in (GUARDS, (PAGE,)))
        suite = Node(executable=SUITE, arguments=[*together, *level], **common)
        return [*map(alone, guards), suite, *map(alone, page)]
    return [*map(alone, names)]


def _rig_file(path: str) -> str:
    """Return the parameter file of the rig."""
    share = Path(get_package_share_directory('hunt_ros'))
    return _file(path, 'rig') or str(share / 'config' / 'rig.yaml')


def _file(path: str, argument: str) -> str:
    """Return a path that was given, or ''; launch itself only warns where there is no file."""
    if path and not Path(path).is_file():
        raise FileNotFoundError(f'{argument}:={path}: no such parameter file')
    return path
