"""How the nodes of the suite are started and waited for."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hunt_ros.cli.support.console_link import ConsoleLink, Line
from hunt_ros.cli.support.processes import NodeSpec, Processes
from hunt_ros.errors import HuntError
from hunt_ros.suite import SUITE

_READY_S = 60.0

Parameters = Mapping[str, Mapping[str, object]]


def free_port() -> int:
    """Return a TCP port of the loopback interface that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


def start_console(processes: Processes) -> ConsoleLink:
    """Start the console node, and return our end of it."""
    return ConsoleLink(processes.start(NodeSpec('console', piped=True)), processes)


def start_nodes(
    processes: Processes,
    names: Sequence[str],
    common: Mapping[str, object],
    parameters: Parameters,
    files: Sequence[Path] = (),
    one_process: bool = False,
    needed: bool = True,
) -> None:
    """
    Start nodes by name.

    Parameters
    ----------
    processes : Processes
        The run.
    names : sequence of str
        Executables.
    common : mapping
        Parameters of all of them.
    parameters : mapping of str to mapping
        Parameters of each, by node name.
    files : sequence of Path
        ROS parameter files for all of them.
    one_process : bool
        True for all of them in one process, which takes less memory and less CPU; one that
        fails ends all.
    needed : bool
        False where the run goes on when one of them ends.
    """
    if one_process:
        # A command line cannot name a parameter of one node under a namespace: a file can.
        own = processes.logs / f'{SUITE}.yaml'
        own.write_text(
            json.dumps(
                {
                    f'/**/{name}': {'ros__parameters': {**common, **parameters.get(name, {})}}
                    for name in names
                }
            ),
            encoding='utf-8',
        )
        processes.start(NodeSpec(SUITE, {}, [*files, own], nodes=names))
        return
    for name in names:
        values = {**common, **parameters.get(name, {})}
        processes.start(NodeSpec(name, values, files, needed=needed))


def wait_until_up(
    link: ConsoleLink, names: Sequence[str], show: Callable[[Line], None] = lambda line: None
) -> None:
    """
    Wait until each node has reported its health; one that is compiling has time.

    `show` gets what nodes say of their compilation.

    Raises
    ------
    HuntError
        Naming the nodes that did not come up, or the one that ended.
    """
    missing = set(names)
    while missing:
        for line in link.lines(_READY_S):
            if line['topic'] == '/diagnostics':
                missing.discard(str(line['name']).rsplit('/', 1)[-1])
            if line['topic'] == 'progress':
                show(line)
                break
            if not missing:
                break
        else:
            raise HuntError(f'not up after {_READY_S:.0f} s: {", ".join(sorted(missing))}')
