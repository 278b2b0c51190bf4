"""
The program `hunt`: finds the verb, runs it, turns an error into one line and an exit code.

Exit codes: 0 done, 1 the work found a failure that it reports, 2 bad usage or
bad input, 3 an error of the program itself, 130 interrupted.
"""

from __future__ import annotations

import argparse
import io
import logging
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn

from hunt_ros import __version__
from hunt_ros.compiled import on_compilation
from hunt_ros.errors import HuntError, not_installed

#: Verb -> module of `hunt_ros.cli`, in the order of the help text.
VERBS: dict[str, str] = {
    'demo': 'demo',
    'run': 'run',
    'call': 'call',
    'check': 'check',
    'simulate': 'simulate',
    'replay': 'replay',
    'identify': 'identify',
    'plan': 'plan',
    'report': 'report',
    'normal-form': 'normal_form',
    'info': 'info',
    'import': 'import_',
    'export': 'export',
    'calibrate': 'calibrate',
    'compile': 'compile',
    'completion': 'completion',
}


class _UsageError(Exception):
    """What is wrong with the words of a command."""


class _OneLineParser(argparse.ArgumentParser):
    """An argument parser whose complaint is one line, without the usage block."""

    def __init__(self, **options: Any) -> None:
        # An abbreviation would mean another option as soon as one with its letters is added.
        super().__init__(allow_abbrev=False, **options)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse a word that nothing takes in the name of the verb, not of all verbs."""
        found, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f'unrecognized arguments: {" ".join(rest)}')
        return found, rest

    def error(self, message: str) -> NoReturn:
        raise _UsageError(f'{self.prog}: {message} (see {self.prog} --help)')


def parser_of(verb: str | None) -> argparse.ArgumentParser:
    """Build the parser; only the verb that is asked for is imported in full."""
    parser = _OneLineParser(
        prog='hunt',
        description='Live monitoring of hunting motion on a railway roller rig.',
        epilog='Each verb has its own help: hunt VERB --help',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'hunt_ros {__version__}')
    verbs = parser.add_subparsers(
        dest='verb', metavar='VERB', required=True, parser_class=_OneLineParser
    )
    for name, module_name in VERBS.items():
        if verb in VERBS and name != verb:
            continue
        module = import_module(f'hunt_ros.cli.{module_name}')
        subparser = verbs.add_parser(
            name,
            help=module.SUMMARY,
            description=module.SUMMARY,
            epilog=f'example:\n  {module.EXAMPLE}',
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.configure(subparser)
        subparser.set_defaults(run=module.run)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """
    Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Words after the program's name; those of the process by default.

    Returns
    -------
    int
        Exit code.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    name = f'hunt {words[0]}' if words and words[0] in VERBS else 'hunt'
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may lack a sign of a name
            stream.reconfigure(errors='replace')
    # Where it keeps its cache when the home folder is read-only is nothing to act on.
    logging.getLogger('matplotlib').setLevel(logging.ERROR)
    try:
        parsed = parser_of(words[0] if words else None).parse_args(words)
        on_compilation(lambda text: print(f'{name}: {text}', file=sys.stderr, flush=True))
        code: int = parsed.run(parsed)
        return code
    except _UsageError as error:
        return _ended(str(error), 2)
    except HuntError as error:
        return _ended(f'{name}: {error}', 2)
    except BrokenPipeError:
        # The reader went away (`hunt ... | head`): not our failure.
        sys.stderr.close()
        return 0
    except (OSError, MemoryError) as error:
        # A full disk, a folder that may not be written: said in one line, wherever it was met.
        return _ended(f'{name}: {_what_failed(error)}', 2)
    except RecursionError:
        return _ended(f'{name}: an input is nested too deeply to be read', 2)
    except KeyboardInterrupt:
        return _ended(f'{name}: interrupted', 130)
    except Exception as error:
        if said := not_installed(error):
            return _ended(f'{name}: {said}', 2)
        if os.environ.get('HUNT_TRACE'):
            raise
        kind = type(error).__name__
        text = ' '.join(str(error).split())
        return _ended(
            f'{name}: internal error ({kind}: {text:.200}), please report it;'
            ' HUNT_TRACE=1 shows where',
            3,
        )


def _ended(line: str, code: int) -> int:
    print(line, file=sys.stderr)
    return code


def _what_failed(error: OSError | MemoryError) -> str:
    """Name the file and what the system says of it."""
    if isinstance(error, MemoryError):
        return f'not enough memory ({error})' if str(error) else 'not enough memory'
    where = f'{error.filename}: ' if error.filename is not None else ''
    return f'{where}{error.strerror or type(error).__name__}'


if __name__ == '__main__':
    sys.exit(main())
