"""`hunt call SERVICE`: act on a running rig, as a button of a control panel would."""

from __future__ import annotations

import argparse

from hunt_ros.cli.support import options
from hunt_ros.errors import HuntError
from hunt_ros.services import SERVICES

SUMMARY = 'acknowledge, start or stop the profile, mark, stop: call a service of the running rig'
EXAMPLE = "hunt call mark 'bump at joint 3'"


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    width = max(map(len, SERVICES)) + 2
    lines = (
        f'  {word:{width}}{service.does}'
        + (f' (WORDS: {service.words})' if service.words_topic else '')
        for word, service in SERVICES.items()
    )
    listed = '\n'.join(lines)
    parser.description = f'{parser.description}\n\nservices:\n{listed}'
    parser.add_argument(
        'service', choices=tuple(SERVICES), metavar='SERVICE', help='one of those listed above'
    )
    parser.add_argument('words', nargs='?', default='', help='words that go with it')
    options.add_namespace(parser)
    parser.add_argument(
        '--wait',
        type=options.number(0.0, 600.0, 's'),
        default=5.0,
        metavar='S',
        help='how long to look for the service (default: %(default)g s)',
    )
    options.add_json(parser, 'the answer')


def run(arguments: argparse.Namespace) -> int:
    """Call it: 0 done, 1 refused; a HuntError (2) where nobody offers it."""
    from hunt_ros.cli.support.output import write_json
    from hunt_ros.cli.support.processes import NodeSpec, ask

    service = SERVICES[arguments.service]
    words = ' '.join(arguments.words.split())
    if words and not service.words_topic:
        raise HuntError(f'{arguments.service}: takes no words, got {arguments.words!r}')
    parameters = {'word': arguments.service, 'wait_s': float(arguments.wait), 'words': words}
    answer = ask(NodeSpec('service_call', parameters), arguments.namespace)
    if answer['success'] is None:
        raise HuntError(f'{answer["service"]}: {answer["message"]}')
    if arguments.json != '-':
        print(answer['message'] or ('done' if answer['success'] else 'refused'))
    if arguments.json:
        write_json(answer, arguments.json)
    return 0 if answer['success'] else 1
