"""`hunt run`: the whole suite on this machine, until Ctrl-C."""

from __future__ import annotations

import argparse
import math
import time

from hunt_ros.cli.support import options
from hunt_ros.suite import PAGE_PORT

SUMMARY = 'start every node of the suite on this machine and show what they see'
EXAMPLE = 'hunt run --simulated --normal-form bags/paper.yaml --duration 60'

#: It is looked so often whether a node has ended that the run goes on without, s.
_LOOK_S = 1.0


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    rig = parser.add_mutually_exclusive_group()
    rig.add_argument('--simulated', action='store_true', help='simulate the rig')
    rig.add_argument(
        '--listen',
        action='store_true',
        help='start only the nodes that listen: the sensor nodes are yours, or a live replay',
    )
    parser.add_argument(
        '--sim-time',
        action='store_true',
        help='follow /clock, which a live replay publishes: for hunt replay --live',
    )
    parser.add_argument(
        '--one-process',
        action='store_true',
        help='all nodes in one process: half the memory; a node that fails ends all',
    )
    options.add_page(parser, str(PAGE_PORT))
    options.add_rig(parser)
    options.add_normal_form(parser)
    options.add_directory(parser)
    options.add_namespace(parser)
    parser.add_argument(
        '--duration',
        type=options.number(0.0, options.LONGEST_S, 's', above=True),
        metavar='S',
        help='end after S seconds instead of at Ctrl-C',
    )


def run(arguments: argparse.Namespace) -> int:
    """Run until interrupted, or for the duration asked for."""
    from hunt_ros.cli.support import suite
    from hunt_ros.cli.support.key_commands import KeyCommands
    from hunt_ros.cli.support.narration import STYLES
    from hunt_ros.cli.support.processes import Processes
    from hunt_ros.cli.support.view import View
    from hunt_ros.dynamics.identified import NEWEST_FILE
    from hunt_ros.errors import ConfigError
    from hunt_ros.services import SERVICES
    from hunt_ros.suite import ALARM_OUTPUTS, LISTENERS, OPTIONAL, PAGE, SIMULATOR, sources_of

    if not (arguments.simulated or arguments.listen or arguments.rig):
        raise ConfigError(
            'which rig? Expected --simulated (a simulated one), --listen (sensor nodes of your'
            ' own, or hunt replay --live) or --rig FILE (where the drivers find it)'
        )
    kept = arguments.directory / NEWEST_FILE
    form = arguments.normal_form or (kept if kept.exists() else None)
    files = [*arguments.rig, *([form] if form else [])]
    if form:
        options.read_text(form, 'normal form')
    rig = options.rig_of(arguments)
    alarms = options.alarm_outputs_of(arguments)
    options.make_folder(arguments.directory, 'recordings')
    sources = sources_of(rig.channels)
    names: tuple[str, ...] = LISTENERS if arguments.listen else (*LISTENERS, *sources)
    parameters: dict[str, dict[str, object]] = {
        'bag_recorder': {'directory': str(arguments.directory)},
        'normal_form_identifier': {'directory': str(arguments.directory)},
    }
    if arguments.simulated:
        # Listeners first, and the recorder ended last: the order matters in one process.
        names = (*LISTENERS, SIMULATOR, *sources)
        if not arguments.rig:  # else the file says where the simulator is
            port = suite.free_port()
            parameters |= {name: {'port': port} for name in (SIMULATOR, *sources)}
    began = time.monotonic()
    with Processes(arguments.namespace, arguments.directory / 'logs', private=False) as processes:
        link = suite.start_console(processes)
        common: dict[str, object] = {'use_sim_time': True} if arguments.sim_time else {}
        suite.start_nodes(processes, names, common, parameters, files, arguments.one_process)
        print(f'{len(names)} nodes under /{arguments.namespace}; logs in {processes.logs}')
        print(f'normal form: {form or "none yet, the first recording gives one"}')
        if arguments.page is not None:  # a process of its own: the rig runs on without it
            page = arguments.page or PAGE_PORT
            own = {PAGE: {'port': page, 'directory': str(arguments.directory)}}
            suite.start_nodes(processes, [PAGE], common, own, files, needed=False)
            print(f'page: http://127.0.0.1:{page}/')
        if alarms:
            suite.start_nodes(processes, [ALARM_OUTPUTS], common, {}, files, needed=False)
            print(f'an alarm calls by {" and ".join(alarms)}')
        words = [word for word, service in SERVICES.items() if service.node in names]
        print(f'from another terminal: hunt call {" | ".join(words)}')
        ends = math.inf if arguments.duration is None else began + arguments.duration
        with View() as view, KeyCommands(link, view, names) as commands:
            try:
                while (left_s := ends - time.monotonic()) > 0.0:
                    for name, ending in processes.lost().items():
                        view.say(f'{ending}; {OPTIONAL[name]}', STYLES['ERROR'])
                    for line in commands.lines(min(left_s, _LOOK_S)):
                        view.show(line)
            except KeyboardInterrupt:
                view.say('ending every node')
    return 0
