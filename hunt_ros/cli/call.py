"""`hunt call SERVICE`: act on a running rig, as a button of a control panel would."""

from __future__ import annotations

import argparse

from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found
from hunt_ros.cli.support.processes import NodeSpec, ask
from hunt_ros.errors import HuntError
from hunt_ros.services import SERVICES
from hunt_ros.suite import ALARM_OUTPUTS

EXAMPLE = "hunt call mark 'bump at joint 3'"


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    width = max(map(len, SERVICES)) + 2
    lines = (
        f'  {word:{width}}{service.does}' + (f' (WORDS: {service.words})' if service.words else '')
        for word, service in SERVICES.items()
    )
    listed = '\n'.join(lines)
    parser.description = f'{parser.description}\n\nservices:\n{listed}'
    parser.add(
        'service', choices=tuple(SERVICES), metavar='SERVICE', help='one of those listed above'
    )
    parser.add('words', nargs='?', default='', help='words that go with it')
    longest = options.number(0.0, 600.0, 's')
    what = 'how long to look for the service (%(default)g s)'
    parser.add('--wait', type=longest, default=5.0, metavar='S', help=what)
    parser.add('--namespace', default='rig')


def run(arguments: argparse.Namespace) -> Found:
    """Call it: 0 done, 1 refused; a HuntError (2) where nobody offers it."""
    service = SERVICES[arguments.service]
    words = ' '.join(arguments.words.split())
    if words and not service.words:
        raise HuntError(f'{arguments.service}: takes no words, got {arguments.words!r}')
    parameters = {'word': arguments.service, 'wait_s': float(arguments.wait), 'words': words}
    answer = ask(NodeSpec('service_call', parameters), arguments.namespace)
    if answer['success'] is None:
        named = '; the section alarm_outputs of the rig file (--rig) names what calls'
        more = named if service.node == ALARM_OUTPUTS else ''
        raise HuntError(f'{answer["service"]}: {answer["message"]}{more}')
    said = answer['message'] or ('done' if answer['success'] else 'refused')
    return Found(answer, [said], 0 if answer['success'] else 1)
