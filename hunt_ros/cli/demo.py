"""`hunt demo`: sweep a simulated rig through hunting and back, live, and refit it from its bag."""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path
from typing import Any

from hunt_ros.cli.support import options, suite
from hunt_ros.cli.support.console import Console
from hunt_ros.cli.support.demo_report import show_results
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.cli.support.view import View
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.suite import LISTENERS, PAGE, SIMULATOR, SOURCES

EXAMPLE = 'hunt demo --out recordings'

#: The sweep: up through v_n and v_c, and down again.
_LOW_MPS, _HIGH_MPS = 6.0, 8.8
_TIMES_S = (0.0, 10.0, 250.0, 275.0, 515.0, 530.0)
_SPEEDS_MPS = (_LOW_MPS, _LOW_MPS, _HIGH_MPS, _HIGH_MPS, _LOW_MPS, _LOW_MPS)
#: Bumps on the way up, inside the basin: free decays tell the damping below v_c.
_KICKS = ((60.0, 0.10e-3), (120.0, 0.10e-3), (160.0, 0.08e-3))
#: The most that a slow and busy machine takes; a node that ends by itself is seen at once.
_CLOSING_S, _IDENTIFYING_S = 120.0, 900.0


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    where = 'where the results go, in a folder of their own (%(default)s)'
    parser.add('--out', type=Path, default=options.RECORDINGS, metavar='DIR', help=where)
    parser.add('--page')
    parser.add('--pace', type=options.number(0.1, 10.0), default=5.0)
    parser.add('--seed', default=1)


def run(arguments: argparse.Namespace) -> int:
    """Run the demo from the start to the picture."""
    folder = (arguments.out / f'demo_{datetime.now():%Y%m%d_%H%M%S}').resolve()
    options.refuse_place(folder, 'the results')
    folder.mkdir(parents=True)
    form = folder / 'paper_normal_form.yaml'
    form.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml(), encoding='utf-8')

    bag: Path | None = None
    with View() as view:
        try:
            with Supervisor('rig', folder / 'logs', private=True) as supervisor:
                console = Console(supervisor, view, (*LISTENERS, *SOURCES))
                with console:
                    _start(supervisor, console, view, arguments, folder, form)
                    _sweep(console, view)
                    bag = _close(console, view)
        except KeyboardInterrupt:
            view.say(f'stopped; what was recorded is in {folder}')
            return 130
    refitted = folder / 'normal_form.yaml'
    if bag is None or not refitted.exists():
        again = f'; hunt identify {bag} says what is missing' if bag else ''
        view.say(f'no refitted normal form: see {folder}/logs{again}', 'bold red')
        return 1
    show_results(bag, refitted, folder, view)
    return 0


def _start(
    supervisor: Supervisor,
    console: Console,
    view: View,
    arguments: argparse.Namespace,
    folder: Path,
    form: Path,
) -> None:
    """Start the listeners, then the rig; return when all are up."""
    profile = Profile((Corners(_TIMES_S, _SPEEDS_MPS),), 'up and down')
    parameters = suite.simulated_run(folder, profile, arguments.pace, _KICKS, seed=arguments.seed)
    parameters['bag_recorder']['operator'] = 'hunt demo'
    view.say('Starting seven ROS 2 nodes on this machine (Ctrl-C ends them all) ...')
    # At pace 1 the rig publishes no /clock.
    common: dict[str, object] = {'use_sim_time': True} if arguments.pace != 1.0 else {}
    suite.start_nodes(supervisor, LISTENERS, common, parameters, [form])
    console.wait_until_up(LISTENERS)
    if arguments.page is not None:
        port = arguments.page or suite.free_port()
        view.say(suite.start_page(supervisor, port, folder, common, [form]))
        console.wait_until_up([PAGE])
    suite.start_nodes(supervisor, [SIMULATOR], {}, parameters)
    console.wait_until_up([SIMULATOR])
    suite.start_nodes(supervisor, SOURCES, common, parameters)
    view.say(
        f'Sweeping {_LOW_MPS:g} -> {_HIGH_MPS:g} -> {_LOW_MPS:g} m/s in'
        f' {_TIMES_S[-1]:.0f} s, {arguments.pace:g} times as fast as real time.'
        ' The alarm holds the coefficients (33) of the paper.'
    )


def _sweep(console: Console, view: View) -> None:
    """Narrate until the profile has run, or cannot go on; one that is held waits for its key."""
    while True:
        for line in console.lines(10.0):
            if line['topic'] != 'speed/status':
                continue
            if line['profile_state'] == 'finished':
                return
            if line['emergency_stop'] == 'true' or line['interlock_state'] == 'tripped':
                view.say(f'The sweep has ended early: {line["message"]}', 'yellow')
                view.say('What was recorded is kept. On a busy machine try: hunt demo --pace 1')
                return


def _close(console: Console, view: View) -> Path | None:
    """Close the recording and wait for the identifier's word on it."""
    console.call('stop-recording')
    closed = (x for x in console.lines(_CLOSING_S) if x['topic'] == 'recording/closed')
    if (line := next(closed, None)) is None:
        return None
    view.say('Identifying the normal form from the recording ...')
    next(filter(_last_word, console.lines(_IDENTIFYING_S)), None)
    return Path(line['data'])


def _last_word(line: dict[str, Any]) -> bool:
    """Return True if the identifier has said what it makes of the recording."""
    if line['topic'] == '/diagnostics':
        name: str = line['name']
        return name.endswith('normal_form_identifier') and line['level'] in ('WARN', 'ERROR')
    return bool(line['topic'] == 'hunting/normal_form')
