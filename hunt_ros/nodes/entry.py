"""
Where a node process begins: signals first, then the imports, which take seconds.

The console scripts stand in `setup.py`; `python -m hunt_ros.nodes.entry NODE...` starts any node,
or several in one process.
"""

from __future__ import annotations

import sys
import traceback
from functools import partial
from importlib import import_module
from itertools import takewhile
from typing import NoReturn

from hunt_ros.nodes.support.ending import Ending
from hunt_ros.suite import NODES, SUITE


def start(*nodes: str) -> NoReturn:
    """
    Run nodes in this process until it is asked to end.

    Parameters
    ----------
    *nodes : str
        Their modules in `hunt_ros.nodes`, which have `make_node`, in the order in which they
        start; they end in the opposite one.
    """
    ending = Ending(nodes[0] if len(nodes) == 1 else SUITE)
    ending.say('starting')
    code = 1
    try:
        run = import_module('hunt_ros.nodes.support.runtime').run
        makers = [import_module(f'hunt_ros.nodes.{node}').make_node for node in nodes]
        code = run(makers, ending)
    except Exception:
        traceback.print_exc()
    ending.leave(code)


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
