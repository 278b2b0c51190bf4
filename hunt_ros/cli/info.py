"""`hunt info BAG`: what is in a recording, what is wrong with it, and a sound copy of it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.cli.support import options

if TYPE_CHECKING:
    from hunt_ros.bag.inspection import Inspection
    from hunt_ros.bag.repair import Repair

SUMMARY = 'say what is in a recording and what is wrong with it; --repair saves what is sound'
EXAMPLE = 'hunt info bags/damaged.mcap --repair saved'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('bag', type=Path, help='folder, .mcap or .db3; also one not closed')
    parser.add_argument(
        '--repair',
        type=options.new_folder,
        metavar='OUT',
        help='write what can be saved to this new folder',
    )
    options.add_json(parser, 'the findings')


def run(arguments: argparse.Namespace) -> int:
    """Inspect, and repair if asked: 0 for a sound recording, 1 for one with problems."""
    from hunt_ros.bag.inspection import inspect
    from hunt_ros.bag.repair import repair
    from hunt_ros.cli.support.output import progress, write_json
    from hunt_ros.errors import BagError

    found: Inspection | None = None
    unreadable = ''
    try:
        with progress('reading') as advance:
            found = inspect(arguments.bag, advance)
    except BagError as error:
        # Even what cannot be opened may hold something to save.
        if arguments.repair is None or not arguments.bag.exists():
            raise
        unreadable = str(error)
    repaired = repair(arguments.bag, arguments.repair) if arguments.repair else None
    if arguments.json != '-':
        _print(found, repaired, unreadable)
    if arguments.json:
        document: dict[str, object] = (
            found.to_json() if found is not None else {'problems': [_unreadable(unreadable)]}
        )
        if repaired is not None:
            document['repair'] = _repair_json(repaired)
        write_json(document, arguments.json)
    if repaired is not None:
        return 1 if repaired.left_out else 0
    return 1 if found is not None and found.problems else 0


def _unreadable(text: str) -> dict[str, object]:
    return {'kind': 'damaged_file', 'text': text, 'time_s': None}


def _repair_json(repaired: Repair) -> dict[str, object]:
    return {
        'path': str(repaired.path),
        'messages': repaired.messages,
        'saved': dict(repaired.saved),
        'lost_bytes': repaired.lost_bytes,
        'lost_chunks_s': [(last - first) / 1e9 for first, last in repaired.lost_spans_ns],
        'problems': repaired.problems,
        'left_out': repaired.left_out,
    }


def _print(found: Inspection | None, repaired: Repair | None, unreadable: str) -> None:
    if found is None:
        print(unreadable)
    else:
        _print_found(found)
    if repaired is not None:
        print(f'repaired: {repaired}')
        for problem in repaired.problems:
            print(f'  {problem}')


def _print_found(found: Inspection) -> None:
    from hunt_ros.samples import counted

    size = found.size_bytes / 1e6
    print(
        f'{found.path}: {found.duration_s:.3f} s, {found.messages} messages, {size:.2f} MB'
        f' in {counted(len(found.files), "file")}'
    )
    for name, text in found.notes.items():
        if text:
            print(f'  {name}: {text.splitlines()[0] if text else ""}')
    width = max((len(topic.name) for topic in found.topics), default=0)
    for topic in found.topics:
        rate = f'{topic.rate_hz:.1f} Hz' if topic.rate_hz else '-'
        print(f'  {topic.name:{width}}  {topic.messages:9d}  {rate:>10}  {topic.type}')
    for problem in found.problems:
        at = f' at {problem.time_s:.3f} s' if problem.time_s is not None else ''
        print(f'{problem.kind}{at}: {problem.text}')
    if not found.problems:
        print('sound')
