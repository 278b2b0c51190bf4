"""
Where a node process begins: signals first, then the imports, which take seconds.

The console scripts stand in `setup.py`; `python -m hunt_ros.nodes.entry NODE...` starts any node,
or several in one process.
"""

from __future__ import annotations

import faulthandler
import sys
import traceback
from collections.abc import Callable
from functools import partial
from importlib import import_module
from itertools import takewhile
from typing import Any, NoReturn

from hunt_ros.errors import not_installed
from hunt_ros.nodes.support.ending import Ending
from hunt_ros.suite import DRIVE, NODES, SENSORS, START_S, SUITE

#: A start that lasts longer says where each thread is, s: it may hang in the middleware, and is
#: ended after a minute (`cli.support.supervisor`).
_LONG_S = 45.0


def start(*nodes: str) -> NoReturn:
    """
    Run nodes in this process until it is asked to end.

    Parameters
    ----------
    *nodes : str
        Sensors, or modules in `hunt_ros.nodes`, which have `make_node`, in the order in which
        they start; they end in the opposite one.
    """
    name = nodes[0] if len(nodes) == 1 else SUITE
    ending = Ending(name, START_S if DRIVE in nodes else 0.0)
    ending.say('starting')
    faulthandler.dump_traceback_later(_LONG_S)
    code = 1
    try:
        import_module('hunt_ros.compiled').serve_live(ending.say)
        run = import_module('hunt_ros.nodes.support.runtime').run
        code = run([_maker(node) for node in nodes], ending)
    except Exception as error:
        if said := not_installed(error):
            ending.say(said)
            code = 2
        else:
            traceback.print_exc()
    ending.leave(code)


def _maker(node: str) -> Callable[[], Any]:
    """Return what makes a node: the sensors are one kind, one a channel."""
    for channel, name in SENSORS.items():
        if name == node:
            return partial(import_module('hunt_ros.nodes.support.sensor').SensorNode, channel)
    maker: Callable[[], Any] = import_module(f'hunt_ros.nodes.{node}').make_node
    return maker


#: What the executables of `setup.py` import: a function for each node.
globals().update({name: partial(start, name) for name in NODES})


def suite() -> NoReturn:
    """Run the nodes that the command line names, before its options: `suite NODE...`."""
    names = list(takewhile(lambda word: not word.startswith('-'), sys.argv[1:]))
    del sys.argv[1 : 1 + len(names)]
    if not names:
        print(f'{SUITE}: which nodes? Expected some of {", ".join(NODES)}', file=sys.stderr)
        sys.exit(2)
    start(*names)


if __name__ == '__main__':
    suite()
