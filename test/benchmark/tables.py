"""
Where benchmark results go: one section of docs/benchmarks.md for each benchmark.

A benchmark prints its table and replaces its own section, so the page always
holds what the commands printed, and nothing else.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from pathlib import Path

PAGE = Path(__file__).parents[2] / 'docs' / 'benchmarks.md'


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


def publish(name: str, title: str, text: str, page: Path = PAGE) -> None:
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
    """
    body = f'<!-- {name} -->\n## {title}\n\n`make {name}` ({machine()})\n\n{text.strip()}\n'
    section = f'{body}<!-- /{name} -->\n'
    print(section)
    old = (
        page.read_text()
        if page.exists()
        else '# Benchmarks\n\nEach section is printed by the command it names.\n'
    )
    start, end = old.find(f'<!-- {name} -->'), old.find(f'<!-- /{name} -->\n')
    if start >= 0 and end >= 0:
        new = old[:start] + section + old[end + len(f'<!-- /{name} -->\n') :]
    else:
        new = f'{old.rstrip()}\n\n{section}'
    page.parent.mkdir(exist_ok=True)
    page.write_text(new)
