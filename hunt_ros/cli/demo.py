"""`hunt demo`: sweep a simulated rig through hunting and back, live, and refit it from its bag."""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hunt_ros.cli.support import options
from hunt_ros.cli.support.narration import STYLES

if TYPE_CHECKING:
    from hunt_ros.cli.support.key_commands import KeyCommands
    from hunt_ros.cli.support.supervisor import Supervisor
    from hunt_ros.cli.support.view import View

SUMMARY = 'sweep the simulated rig through hunting and back, live, and refit it (3 minutes)'
EXAMPLE = 'hunt demo --out recordings'

#: The sweep: up through v_n and v_c, and down again.
_LOW_MPS, _HIGH_MPS = 6.0, 8.8
_TIMES_S = (0.0, 10.0, 250.0, 275.0, 515.0, 530.0)
_SPEEDS_MPS = (_LOW_MPS, _LOW_MPS, _HIGH_MPS, _HIGH_MPS, _LOW_MPS, _LOW_MPS)
#: Bumps on the way up, inside the basin: free decays tell the damping below v_c.
_KICKS = ((60.0, 0.10e-3), (120.0, 0.10e-3), (160.0, 0.08e-3))
#: The most that a slow and busy machine takes; a node that ends by itself is seen at once.
_CLOSING_S, _IDENTIFYING_S = 120.0, 900.0


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--out',
        type=Path,
        default=Path('recordings'),
        metavar='DIR',
        help='where the results go, in a folder of their own (default: %(default)s)',
    )
    options.add_page(parser, 'a free one')
    parser.add_argument(
        '--keep', action='store_true', help='the same, and leave it up after the sweep'
    )
    options.add_pace(parser, 10.0, 5.0)
    options.add_seed(parser, 1)


def run(arguments: argparse.Namespace) -> int:
    """Run the demo from the start to the picture."""
    from hunt_ros.cli.support.console_link import ConsoleLink
    from hunt_ros.cli.support.demo_report import show_results
    from hunt_ros.cli.support.key_commands import KeyCommands
    from hunt_ros.cli.support.supervisor import Supervisor
    from hunt_ros.cli.support.view import View
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
    from hunt_ros.suite import LISTENERS, SOURCES

    folder = (arguments.out / f'demo_{datetime.now():%Y%m%d_%H%M%S}').resolve()
    options.make_folder(folder, 'the results')
    form = folder / 'paper_normal_form.yaml'
    form.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml(), encoding='utf-8')

    bag: Path | None = None
    with View() as view:
        try:
            with (
                Supervisor('rig', folder / 'logs', private=True) as supervisor,
                KeyCommands(ConsoleLink(supervisor), view, (*LISTENERS, *SOURCES)) as commands,
            ):
                _start(supervisor, commands, view, arguments, folder, form)
                _sweep(commands, view)
                bag = _close(commands, view)
                if arguments.keep:
                    _keep(commands, view)
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
    commands: KeyCommands,
    view: View,
    arguments: argparse.Namespace,
    folder: Path,
    form: Path,
) -> None:
    """Start the listeners, then the rig; return when all are up."""
    from hunt_ros.cli.support import suite
    from hunt_ros.dynamics.profile import Corners, Profile
    from hunt_ros.suite import LISTENERS, PAGE, SIMULATOR, SOURCES

    profile = Profile((Corners(_TIMES_S, _SPEEDS_MPS),), 'up and down')
    parameters = suite.simulated_run(folder, profile, arguments.pace, _KICKS, seed=arguments.seed)
    parameters['bag_recorder']['operator'] = 'hunt demo'
    page = arguments.page
    if page == 0 or (page is None and arguments.keep):
        page = suite.free_port()
    view.say('Starting seven ROS 2 nodes on this machine (Ctrl-C ends them all) ...')
    common = suite.follow_clock(arguments.pace)
    suite.start_nodes(supervisor, LISTENERS, common, parameters, [form])
    suite.wait_until_up(commands, LISTENERS)
    if page is not None:
        own = {PAGE: {'port': page, 'directory': str(folder)}}
        suite.start_nodes(supervisor, [PAGE], common, own, [form])
        suite.wait_until_up(commands, [PAGE])
        view.say(f'The page of the operator: http://127.0.0.1:{page}/')
    suite.start_nodes(supervisor, [SIMULATOR], {}, parameters)
    suite.wait_until_up(commands, [SIMULATOR])
    suite.start_nodes(supervisor, SOURCES, common, parameters)
    view.say(
        f'Sweeping {_LOW_MPS:g} -> {_HIGH_MPS:g} -> {_LOW_MPS:g} m/s in'
        f' {_TIMES_S[-1]:.0f} s, {arguments.pace:g} times as fast as real time.'
        ' The alarm holds the coefficients (33) of the paper.'
    )


def _keep(commands: KeyCommands, view: View) -> None:
    """Leave everything running until Ctrl-C."""
    view.say('The page stays up until Ctrl-C; then the results are shown.')
    try:
        while True:
            for line in commands.lines(1.0):
                view.show(line)
    except KeyboardInterrupt:
        view.say('ending every node')


def _sweep(commands: KeyCommands, view: View) -> None:
    """Narrate until the profile has run, or cannot go on; one that is held waits for its key."""
    while True:
        for line in commands.lines(10.0):
            view.show(line)
            if line['topic'] != 'speed/status':
                continue
            if line['profile_state'] == 'finished':
                return
            if line['emergency_stop'] == 'true' or line['interlock_state'] == 'tripped':
                view.say(f'The sweep has ended early: {line["message"]}', STYLES['WARN'])
                view.say('What was recorded is kept. On a busy machine try: hunt demo --pace 1')
                return


def _close(commands: KeyCommands, view: View) -> Path | None:
    """Close the recording and wait for the identifier's word on it."""
    commands.call('stop-recording')
    for line in commands.lines(_CLOSING_S):
        view.show(line)
        if line['topic'] == 'recording/closed':
            break
    else:
        return None
    view.say('Identifying the normal form from the recording ...')
    for word in commands.lines(_IDENTIFYING_S):
        view.show(word)
        if _last_word(word):
            break
    return Path(line['data'])


def _last_word(line: dict[str, Any]) -> bool:
    """Return True if the identifier has said what it makes of the recording."""
    if line['topic'] == '/diagnostics':
        name: str = line['name']
        return name.endswith('normal_form_identifier') and line['level'] in ('WARN', 'ERROR')
    return bool(line['topic'] == 'hunting/normal_form')
