"""`hunt completion SHELL`: verbs, options and files at the tabulator key."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

SUMMARY = 'print the script by which a shell completes verbs, options and files'
EXAMPLE = 'hunt completion bash'

SHELLS = ('bash', 'zsh', 'tcsh')
#: Values that are files or folders, by what stands for them in the help.
_FILES = ('FILE', 'BAG', 'DIR', 'PNG', 'OUT', 'PATH|-')


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.description = (
        f'{parser.description}\n\n'
        'hunt completion bash > ~/.local/share/bash-completion/completions/hunt'
    )
    parser.add_argument('shell', choices=SHELLS, help=', '.join(SHELLS))


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    from hunt_ros.cli.main import VERBS, parser_of
    from hunt_ros.errors import HuntError

    try:
        import shtab
    except ImportError as error:
        raise HuntError('shtab is not installed: pip install "hunt_ros[completion]"') from error
    parser = parser_of(None)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb in VERBS:
                _complete_files(action.choices[verb], shtab.FILE)
    print(shtab.complete(parser, arguments.shell))
    return 0


def _complete_files(parser: argparse.ArgumentParser, way: Any) -> None:
    """Mark the values of a verb that are files."""
    for action in parser._actions:
        if action.metavar in _FILES or action.type is Path:
            action.complete = way  # type: ignore[attr-defined]
