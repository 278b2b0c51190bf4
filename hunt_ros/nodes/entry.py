"""
Where a node process begins: signals first, then the imports, which take seconds.

The console scripts stand in `setup.py`; `python -m hunt_ros.nodes.entry NODE` starts any node.
"""

from __future__ import annotations

import sys
import traceback
from functools import partial
from importlib import import_module
from typing import NoReturn

from hunt_ros.nodes.ending import Ending


def start(node: str) -> NoReturn:
    """
    Run one node until it is asked to end.

    Parameters
    ----------
    node : str
        Its module in `hunt_ros.nodes`, which has `make_node`.
    """
    ending = Ending(node)
    ending.say('starting')
    code = 1
    try:
        run = import_module('hunt_ros.nodes.runtime').run
        code = run(import_module(f'hunt_ros.nodes.{node}').make_node, ending)
    except Exception:
        traceback.print_exc()
    ending.leave(code)


lateral_sensor = partial(start, 'lateral_sensor')
yaw_sensor = partial(start, 'yaw_sensor')
roller_speed = partial(start, 'roller_speed')
rig_simulator = partial(start, 'rig_simulator')
hunting_detector = partial(start, 'hunting_detector')
normal_form_identifier = partial(start, 'normal_form_identifier')
bag_recorder = partial(start, 'bag_recorder')

if __name__ == '__main__':
    start(sys.argv.pop(1))
