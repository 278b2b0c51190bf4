"""`hunt info BAG`: what is in a recording, what is wrong with it, and a sound copy of it."""

from __future__ import annotations

import argparse
from pathlib import Path

from hunt_ros.bag.inspection import Inspection, inspect
from hunt_ros.bag.mcap.file import REPAIR
from hunt_ros.bag.repair import repair
from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found, progress
from hunt_ros.samples import counted

EXAMPLE = 'hunt info bags/damaged.mcap --repair saved'


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    parser.add('bag', type=Path, help='folder, .mcap or .db3; also one not closed')
    what = 'write what can be saved to this new folder; then 0 says that no file was left out'
    parser.add('--repair', type=options.new_folder, metavar='OUT', help=what)


def run(arguments: argparse.Namespace) -> Found:
    """
    Inspect, and repair if asked: 0 for a sound recording, 1 for one with problems.

    With a repair 0 where all that is sound was copied, 1 where a file was left out.
    """
    with progress('reading') as advance:
        found = inspect(arguments.bag, advance)
    document, lines = found.to_json(), _lines(found)
    if not arguments.repair:
        return Found(document, lines, 1 if found.problems else 0)
    repaired = repair(arguments.bag, arguments.repair)
    document['repair'] = {
        'path': str(repaired.path),
        'messages': repaired.messages,
        'saved': dict(repaired.saved),
        'lost_bytes': repaired.lost_bytes,
        'lost_chunks_s': [(last - first) / 1e9 for first, last in repaired.lost_spans_ns],
        'problems': repaired.problems,
        'left_out': repaired.left_out,
    }
    told = {problem.text for problem in found.problems}
    more = (f'  {problem}' for problem in repaired.problems if problem not in told)
    lines = [line.replace(REPAIR, '') for line in lines]  # it is what has just been done
    return Found(document, [*lines, f'repaired: {repaired}', *more], 1 if repaired.left_out else 0)


def _lines(found: Inspection) -> list[str]:
    lines = [
        f'{found.path}: {found.duration_s:.3f} s, {found.messages} messages,'
        f' {found.size_bytes / 1e6:.2f} MB in {counted(len(found.files), "file")}'
    ]
    lines += [f'  {name}: {text.splitlines()[0]}' for name, text in found.notes.items() if text]
    width = max((len(topic.name) for topic in found.topics), default=0)
    for topic in found.topics:
        rate = f'{topic.rate_hz:.1f} Hz' if topic.rate_hz else '-'
        lines.append(f'  {topic.name:{width}}  {topic.messages:9d}  {rate:>10}  {topic.type}')
    for problem in found.problems:
        at = f' at {problem.time_s:.3f} s' if problem.time_s is not None else ''
        lines.append(f'{problem.kind}{at}: {problem.text}')
    return lines if found.problems else [*lines, 'sound']
