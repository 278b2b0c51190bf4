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
from hunt_ros.suite import NODES


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


#: What the executables of `setup.py` import: a function for each node.
globals().update({name: partial(start, name) for name in NODES})

if __name__ == '__main__':
    start(sys.argv.pop(1))
