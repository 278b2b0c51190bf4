"""`hunt run`: the whole suite on this machine, until Ctrl-C."""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from socket import socket

from hunt_ros.cli.support import options, suite
from hunt_ros.cli.support.console import Console
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.cli.support.view import View
from hunt_ros.drivers.alarm_output import AlarmSettings
from hunt_ros.drivers.safety_state import state_file
from hunt_ros.dynamics.identified import NEWEST_FILE, IdentifiedNormalForm
from hunt_ros.errors import ConfigError
from hunt_ros.rig import UNSTOPPED
from hunt_ros.services import SERVICES
from hunt_ros.suite import ALARM_OUTPUTS, DRIVE, LISTENERS, NODES, SIMULATOR, hold, sources_of

EXAMPLE = 'hunt run --simulated --normal-form bags/paper.yaml --duration 60'

#: The roller is where it is safe within this, m/s, as the speed node tells at its end.
_THERE_MPS = 0.05
#: DDS gives a domain its ports, and there are no more.
_LAST_DOMAIN = 232
#: Up through v_n and v_c of the built-in rig and back: that of config/rig.yaml.
SWEEP = """
name: up and down
profile:
- hold: {speed_mps: 6.0, duration_s: 30}
- sweep: {low_mps: 6.0, high_mps: 8.9, rate_mps2: 0.013, hold_s: 30}
"""


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    which = partial(options.add, parser.add_mutually_exclusive_group(), **options.FLAG)
    which('--simulated', help='simulate the rig')
    which('--listen', help='only the nodes that listen: the sensor nodes are yours, or a replay')
    parser.add('--sim-time', **options.FLAG, help='follow /clock: for hunt replay --live')
    what = 'all nodes but the guards in one process: half the memory; they fail together'
    parser.add('--one-process', **options.FLAG, help=what)
    parser.add('--page', '--rig', '--normal-form', '--directory')
    parser.add('--namespace', default='rig')
    longest = options.number(0.0, options.LONGEST_S, 's', above=True)
    parser.add('--duration', type=longest, metavar='S', help='end after S seconds, not at Ctrl-C')


def run(arguments: argparse.Namespace) -> int:
    """Run until interrupted, or for the duration asked for; 1 where the roller may still turn."""
    if not (arguments.simulated or arguments.listen or arguments.rig):
        raise ConfigError(
            'which rig? Expected --simulated (a simulated one), --listen (sensor nodes of your'
            ' own, or hunt replay --live) or --rig FILE (where the drivers find it)'
        )
    if arguments.sim_time and not arguments.listen:
        raise ConfigError('--sim-time: only with --listen, beside hunt replay --live')
    folder, namespace = options.recordings_of(arguments), arguments.namespace
    kept = folder / NEWEST_FILE
    form = arguments.normal_form or (kept if kept.exists() else None)
    files = [*arguments.rig, *([form] if form else [])]
    rig = options.rig_of(arguments)
    if form:
        IdentifiedNormalForm.read(form).refuse_other(rig.rig_name, str(form))
    sources = () if arguments.listen else sources_of(rig.channels)
    options.refuse_drivers(arguments, sources)
    alarms = AlarmSettings.told(options.rig_texts(arguments))
    options.refuse_place(folder, 'the recordings')
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {*LISTENERS, *sources}
    wanted |= {ALARM_OUTPUTS} if alarms else set()
    wanted |= {SIMULATOR} if arguments.simulated else set()
    names = tuple(name for name in NODES if name in wanted)
    state = state_file(folder, namespace)
    tested = state.with_suffix('.tested')
    parameters: dict[str, dict[str, object]] = {
        DRIVE: {'state_file': str(state)},
        ALARM_OUTPUTS: {'tested_file': str(tested)},
        'bag_recorder': {'directory': str(folder)},
        'normal_form_identifier': {'directory': str(folder)},
    }
    if arguments.simulated and not arguments.rig:  # else the file says where it is, what it does
        parameters[DRIVE]['profile'] = SWEEP
        port = suite.free_port()
        for name in (SIMULATOR, *sources):
            parameters.setdefault(name, {})['port'] = port
    began = time.monotonic()
    with (
        _alone(namespace, names),
        Supervisor(namespace, folder / 'logs', False, alarms=alarms) as supervisor,
        View(namespace, rig.speed_unit) as view,
    ):
        console = Console(supervisor, view, names)
        try:
            common: dict[str, object] = {'use_sim_time': True} if arguments.sim_time else {}
            suite.start_nodes(supervisor, names, common, parameters, files, arguments.one_process)
            view.say(f'{len(names)} nodes under /{namespace}; logs in {supervisor.logs}')
            view.say(f'normal form: {form or "none yet, the first recording gives one"}')
            if arguments.page is not None:  # a process of its own: the rig runs on without it
                view.say(suite.start_page(supervisor, arguments.page, folder, common, files))
            if alarms:
                view.say(
                    f'an alarm calls by {" and ".join(alarms)}; tested last: {_tested(tested)}'
                )
            if DRIVE in names and arguments.rig and not rig.drive_watchdog_s:
                view.say(UNSTOPPED)
            words = [word for word, service in SERVICES.items() if service.node in names]
            view.say(f'from another terminal: hunt call {" | ".join(words)}')
            ends = math.inf if arguments.duration is None else began + arguments.duration
            with console:
                for _ in console.lines(ends - time.monotonic()):
                    pass
        except KeyboardInterrupt:
            pass  # a wanted end, as the duration is
        finally:
            safe = _end(supervisor, console, view)
    return 0 if safe else 1


def _alone(namespace: str, names: Sequence[str]) -> socket:
    """
    Start nothing beside nodes of these names: the rig would take it for a second master.

    Returns
    -------
    socket
        Holds the namespace until it is closed: the nodes of another run may only be starting.
    """
    told = os.environ.get('ROS_DOMAIN_ID', '') or '0'
    if not told.isdecimal() or int(told) > _LAST_DOMAIN:
        raise ConfigError(f'ROS_DOMAIN_ID={told}, expected 0 to {_LAST_DOMAIN}')
    where = f'/{namespace.strip("/")}'
    try:
        for name in names:
            hold(f'{where}/{name}', int(told)).close()
        return hold(where, int(told))
    except OSError as error:
        raise ConfigError(f'{error}: choose another --namespace or ROS_DOMAIN_ID') from error


def _tested(file: Path) -> str:
    """Return when `hunt call test-alarm` succeeded last; its file is touched then."""
    if not file.exists():
        return 'never ("hunt call test-alarm" does)'
    return f'{datetime.fromtimestamp(file.stat().st_mtime):%Y-%m-%d %H:%M:%S}'


def _end(supervisor: Supervisor, console: Console, view: View) -> bool:
    """Take the roller to the safe speed, and say how far it is; return True if it is there."""
    told_s = -math.inf

    def meanwhile() -> None:
        """Say where the roller is, once a second."""
        nonlocal told_s
        for _ in console.lines(0.2):
            pass
        speed, safe = (view.drive_mps(name) for name in ('speed_mps', 'safe_speed_mps'))
        there = speed < safe + _THERE_MPS
        if there:  # the speed node ends before the detector, which then misses the speed
            console.hidden = ('hunting/events', '/diagnostics')
        if math.isfinite(speed + safe) and time.monotonic() - told_s > 1.0:
            told_s, way = time.monotonic(), f'on its way to {safe:.2f} m/s'
            view.say(f'the roller is at {speed:.2f} m/s, {"where it is safe" if there else way}')

    with suppress(OSError):  # a full disk, a terminal that is gone
        view.say('ending every node; Ctrl-C again: at once')
    why = supervisor.wind_down(meanwhile)
    if why:
        speed = view.drive_mps('speed_mps')
        words = f'AT {speed:.2f} m/s' if math.isfinite(speed) else 'AT AN UNKNOWN SPEED'
        with suppress(OSError):
            view.say(f'THE ROLLER RUNS {words} AND NOBODY GUARDS IT: {why}', 'bold red')
    return not why
