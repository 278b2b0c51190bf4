"""`hunt run`: the whole suite on this machine, until Ctrl-C."""

from __future__ import annotations

import argparse
import math
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options
from hunt_ros.suite import PAGE_PORT

if TYPE_CHECKING:
    from hunt_ros.cli.support.console_link import ConsoleLink
    from hunt_ros.cli.support.supervisor import Supervisor
    from hunt_ros.cli.support.view import View

SUMMARY = 'start every node of the suite on this machine and show what they see'
EXAMPLE = 'hunt run --simulated --normal-form bags/paper.yaml --duration 60'

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
        help='all nodes but the guards in one process: half the memory; they fail together',
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
    """Run until interrupted, or for the duration asked for; 1 where the roller may still turn."""
    from hunt_ros.cli.support import suite
    from hunt_ros.cli.support.console_link import ConsoleLink
    from hunt_ros.cli.support.key_commands import KeyCommands
    from hunt_ros.cli.support.supervisor import Supervisor
    from hunt_ros.cli.support.view import View
    from hunt_ros.drivers.safety_state import state_file
    from hunt_ros.dynamics.identified import NEWEST_FILE, IdentifiedNormalForm
    from hunt_ros.errors import ConfigError
    from hunt_ros.services import SERVICES
    from hunt_ros.suite import (
        ALARM_OUTPUTS,
        DRIVE,
        GUARDS,
        LISTENERS,
        PAGE,
        SIMULATOR,
        sources_of,
    )

    if not (arguments.simulated or arguments.listen or arguments.rig):
        raise ConfigError(
            'which rig? Expected --simulated (a simulated one), --listen (sensor nodes of your'
            ' own, or hunt replay --live) or --rig FILE (where the drivers find it)'
        )
    kept = arguments.directory / NEWEST_FILE
    form = arguments.normal_form or (kept if kept.exists() else None)
    files = [*arguments.rig, *([form] if form else [])]
    rig = options.rig_of(arguments)
    if form:
        text = options.read_text(form, 'normal form')
        IdentifiedNormalForm.from_yaml(text, str(form)).refuse_other(rig.rig_name, str(form))
    alarms = options.alarm_outputs_of(arguments)
    options.make_folder(arguments.directory, 'recordings')
    sources = () if arguments.listen else sources_of(rig.channels)
    simulator = (SIMULATOR,) if arguments.simulated else ()
    # Guards first; then who listens, so that no sample is missed.
    names = tuple(name for name in (DRIVE,) if name in sources)
    names += (ALARM_OUTPUTS,) if alarms else ()
    names += (*LISTENERS, *simulator, *(name for name in sources if name not in GUARDS))
    state = state_file(arguments.directory, arguments.namespace)
    parameters: dict[str, dict[str, object]] = {
        DRIVE: {'state_file': str(state)},
        ALARM_OUTPUTS: {'tested_file': str(state.with_suffix('.tested'))},
        'bag_recorder': {'directory': str(arguments.directory)},
        'normal_form_identifier': {'directory': str(arguments.directory)},
    }
    if arguments.simulated and not arguments.rig:  # else the file says where the simulator is
        port = suite.free_port()
        for name in (SIMULATOR, *sources):
            parameters.setdefault(name, {})['port'] = port
    began = time.monotonic()
    logs = arguments.directory / 'logs'
    with Supervisor(arguments.namespace, logs, False, alarms=alarms) as supervisor:
        link = ConsoleLink(supervisor)
        common: dict[str, object] = {'use_sim_time': True} if arguments.sim_time else {}
        suite.start_nodes(supervisor, names, common, parameters, files, arguments.one_process)
        print(f'{len(names)} nodes under /{arguments.namespace}; logs in {supervisor.logs}')
        print(f'normal form: {form or "none yet, the first recording gives one"}')
        if arguments.page is not None:  # a process of its own: the rig runs on without it
            page = arguments.page or PAGE_PORT
            own = {PAGE: {'port': page, 'directory': str(arguments.directory)}}
            suite.start_nodes(supervisor, [PAGE], common, own, files)
            print(f'page: http://127.0.0.1:{page}/')
        if alarms:
            print(f'an alarm calls by {" and ".join(alarms)}')
        words = [word for word, service in SERVICES.items() if service.node in names]
        print(f'from another terminal: hunt call {" | ".join(words)}', flush=True)
        ends = math.inf if arguments.duration is None else began + arguments.duration
        with View(arguments.namespace) as view:
            try:
                with KeyCommands(link, view, names) as commands:
                    while (left_s := ends - time.monotonic()) > 0.0:
                        for line in commands.lines(min(left_s, _LOOK_S)):
                            view.show(line)
            except KeyboardInterrupt:
                pass  # a wanted end, as the duration is
            finally:
                safe = _end(supervisor, link, view)
    return 0 if safe else 1


def _end(supervisor: Supervisor, link: ConsoleLink, view: View) -> bool:
    """Take the roller to the safe speed, and say how far it is; return True if it is there."""
    told_s, arrived = -math.inf, False

    def meanwhile() -> None:
        nonlocal told_s, arrived
        for line in link.lines(0.2):
            # The speed node ends before the detector, which then misses the speed.
            if not arrived or line['topic'] not in ('hunting/events', '/diagnostics'):
                view.show(line)
        speed, safe = (view.drive.get(name) for name in ('speed_mps', 'safe_speed_mps'))
        if speed is not None and safe is not None and time.monotonic() - told_s > 1.0:
            told_s, arrived = time.monotonic(), speed < safe + 0.01
            there = 'where it is safe' if arrived else f'on its way to {safe:.2f} m/s'
            view.say(f'the roller is at {speed:.2f} m/s, {there}')

    with suppress(OSError):  # a full disk, a terminal that is gone
        view.say('ending every node; Ctrl-C again: at once')
    why = supervisor.wind_down(meanwhile)
    if why:
        speed = view.drive.get('speed_mps')
        words = 'AT AN UNKNOWN SPEED' if speed is None else f'AT {speed:.2f} m/s'
        with suppress(OSError):
            view.say(f'THE ROLLER RUNS {words} AND NOBODY GUARDS IT: {why}', 'bold red')
    return not why
