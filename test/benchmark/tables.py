"""
What the benchmarks share: how much is asked for, and where the results go.

A benchmark prints its table. A full run replaces its own section of docs/benchmarks.md, so the
page always holds what the commands printed, and nothing else.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

sys.path.insert(0, str(Path(__file__).parents[1]))  # for what tests share
PAGE = Path(__file__).parents[2] / 'docs' / 'benchmarks.md'
_T = TypeVar('_T')
_R = TypeVar('_R')


def asked(doc: str, /, **numbers: tuple[float, float]) -> argparse.Namespace:
    """
    Read the command line: `--fast`, `--publish`, `--jobs`, and an option for each number.

    Parameters
    ----------
    doc : str
        Of the benchmark.
    **numbers : tuple of float
        Name of an option: its value in the full run, and with `--fast`.

    Returns
    -------
    argparse.Namespace
        `publish` is True for a full run, or one that asks for it.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--fast', action='store_true', help='see that it runs; printed only')
    parser.add_argument('--publish', action='store_true', help='a run that is not full as well')
    parser.add_argument('--jobs', type=int, help='processes; default: one a core')
    for name, (full, fast) in numbers.items():
        parser.add_argument(f'--{name}', type=type(full), help=f'{full:g}; --fast: {fast:g}')
    found = parser.parse_args()
    whole = True
    for name, (full, fast) in numbers.items():
        if getattr(found, name) is None:
            setattr(found, name, fast if found.fast else full)
        whole &= getattr(found, name) >= full
    found.publish |= whole and not found.fast
    return found


def run(
    doc: str,
    name: str,
    title: str,
    work: Callable[[argparse.Namespace, Executor], str],
    **numbers: tuple[float, float],
) -> None:
    """
    Measure, print and publish.

    Parameters
    ----------
    doc, numbers
        See `asked`.
    name, title : str
        See `publish`.
    work : callable
        From what is asked for, and processes to do it in, to Markdown.
    """
    arguments = asked(doc, **numbers)
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context('spawn')) as pool:
        text = work(arguments, pool)
    publish(name, title, text, arguments.publish)


def mapped(pool: Executor, label: str, work: Callable[[_T], _R], tasks: Sequence[_T]) -> list[_R]:
    """Do the tasks in other processes; say on standard error how far they are."""
    found: list[_R] = []
    for result in pool.map(work, tasks):
        found.append(result)
        if len(found) == len(tasks) or not len(found) % max(1, len(tasks) // 10):
            print(f'{label}: {len(found)} of {len(tasks)}', file=sys.stderr, flush=True)
    return found


def machine() -> str:
    """Return one line on the machine a table was measured on."""
    return f'{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}'


def markdown(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table; floats are shown with four significant digits."""
    lines = ['| ' + ' | '.join(header) + ' |', '|' + '---|' * len(header)]
    for row in rows:
        cells = (f'{cell:.4g}' if isinstance(cell, float) else str(cell) for cell in row)
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def publish(name: str, title: str, text: str, really: bool = True, page: Path = PAGE) -> None:
    """
    Print a section and put it into the page, in place of the earlier one.

    Parameters
    ----------
    name : str
        Key of the section: the make target, e.g. ``bench-bags``.
    title : str
        Heading.
    text : str
        Markdown: what was measured, the table, what falls short.
    really : bool
        False: only print it.
    """
    body = f'<!-- {name} -->\n## {title}\n\n`make {name}` ({machine()})\n\n{text.strip()}\n'
    section = f'{body}<!-- /{name} -->\n'
    print(section)
    if not really:
        return
    before, begin, rest = page.read_text().partition(f'<!-- {name} -->')
    after = rest.partition(f'<!-- /{name} -->\n')[2]
    page.write_text(before + section + after if begin else f'{before.rstrip()}\n\n{section}')
