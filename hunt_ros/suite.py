"""
The nodes of the suite: the one list of them.

Executables, launch file, `hunt run` and the sections of a parameter file follow from it. A node
is a module of this name in `hunt_ros.nodes` with a function `make_node`. To be read without
the package installed: `setup.py` makes the executables from it.
"""

from __future__ import annotations

import hashlib
import os
import socket
from collections.abc import Collection

#: Nodes that only listen.
LISTENERS = ('bag_recorder', 'hunting_detector', 'normal_form_identifier')
#: The node of each sensor of motion: started where the rig has its channel.
SENSORS = {'lateral': 'lateral_sensor', 'yaw': 'yaw_sensor', 'axle_box': 'axle_box_sensor'}
#: The node that runs the roller.
DRIVE = 'roller_speed'


def sources_of(channels: Collection[str]) -> tuple[str, ...]:
    """Return the nodes that talk to a rig with these channels."""
    return (*(node for channel, node in SENSORS.items() if channel in channels), DRIVE)


#: Nodes that talk to the simulated rig.
SOURCES = sources_of(('lateral', 'yaw'))
#: The rig that is not there.
SIMULATOR = 'rig_simulator'

#: The executable that runs several of them in one process.
SUITE = 'suite'
#: The operator's page: started where it is asked for, after the extra `dashboard` is installed.
PAGE = 'dashboard'
#: TCP port of the page, where no other is given.
PAGE_PORT = 8088
#: Sound, command and relay for an alarm: started where their parameters name any.
ALARM_OUTPUTS = 'alarm_outputs'
#: They keep the rig safe whatever else dies: started first, and ended by nothing but a wanted end.
GUARDS = (DRIVE, ALARM_OUTPUTS)
#: Nodes without which a run goes on where they refuse to start: what is missing then.
OPTIONAL = {PAGE: 'the rig is watched without the page'}
#: Variable of the environment of a process that was started again: its state is known to be there.
AGAIN = 'HUNT_AGAIN'
#: A start takes no longer than this, s: who waits for a neighbour until then is only starting, and
#: afterwards in trouble; without a word of the detector somebody is called.
START_S = float(os.environ.get('HUNT_START_S', '30'))


def hold(name: str, domain: int) -> socket.socket:
    """
    Hold the full name of a node in a ROS domain until the socket is closed.

    The kernel gives an abstract socket to one process of a network namespace, which is what can
    meet in a ROS domain, and takes it back however that process ends.

    Raises
    ------
    OSError
        If it is held already, saying so.
    """
    key = hashlib.sha256(f'{domain} {name}'.encode()).hexdigest()
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f'\0hunt_ros/{key}')
    except OSError as error:
        held.close()
        raise OSError(f'{name} runs already on this machine in ROS domain {domain}') from error
    return held


class Awaited(str):
    """The level of what has never been there yet: during a start it is only waited for."""


#: Every node that is an executable of the package, in the order of a start: guards first, then who
#: listens, so that no sample is missed.
NODES = (*GUARDS, *LISTENERS, SIMULATOR, *SENSORS.values(), PAGE)
