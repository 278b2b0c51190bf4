"""
The nodes of the suite: the one list of them.

Executables, launch file, `hunt run` and the sections of a parameter file follow from it. A node
is a module of this name in `hunt_ros.nodes` with a function `make_node`. To be read without
the package installed: `setup.py` makes the executables from it.
"""

from __future__ import annotations

#: Nodes that only listen: started first, so that no sample is missed.
LISTENERS = ('bag_recorder', 'hunting_detector', 'normal_form_identifier')
#: Nodes that talk to the rig.
SOURCES = ('lateral_sensor', 'yaw_sensor', 'roller_speed')
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
#: Nodes without which a run goes on: what is missing then.
OPTIONAL = {
    PAGE: 'the rig is watched without the page',
    ALARM_OUTPUTS: 'an alarm calls nobody any more',
}

#: Every node that is an executable of the package.
NODES = (SIMULATOR, *LISTENERS, *SOURCES, *OPTIONAL)
