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
from typing import Any

from hunt_ros import __version__
from hunt_ros.cli.support.options import Parser
from hunt_ros.cli.support.output import Found, tell
from hunt_ros.errors import HuntError, not_installed, one_line

#: Verb -> what it is for, in the order of the help text. Its module is imported where it is used.
VERBS: dict[str, str] = {
    'demo': 'sweep the simulated rig through hunting and back, live, and refit it (3 minutes)',
    'run': 'start every node of the suite on this machine and show what they see',
    'call': 'acknowledge, start, stop, mark: call a service of the running rig',
    'check': 'check a rig before its first run: rate, noise, clocks, encoder, disk; what to do',
    'simulate': 'simulate the rig over a speed profile and write the recording as a bag',
    'replay': 'run a recording through the detector; --live: through the running nodes',
    'identify': 'identify the normal form, with intervals, from recordings',
    'tune': 'settings of the detector over recordings: false alarms an hour and delay of alarm',
    'plan': 'say what to measure next: the profile that teaches the most a minute',
    'report': 'write the report of recordings: one HTML page, and the figures as SVG and PNG',
    'normal-form': 'compute critical speed and normal form of a rig from its parameters',
    'info': 'say what is in a recording and what is wrong with it; --repair: save what is sound',
    'import': 'turn a CSV, MATLAB, NumPy or TDMS file, or a foreign bag, into a bag',
    'export': 'write channels of a recording as CSV',
    'calibrate': 'calibrate a sensor: known displacements in, gain and offset out',
    'compile': 'compile the kernels once, so that no first run waits (make install does it)',
}
#: Verbs that act, and have nothing to tell.
_ACTING = ('demo', 'run', 'compile')


def module_of(verb: str) -> Any:
    """Import the module of a verb; the name of one is a word of Python."""
    name = verb.replace('-', '_') + '_' * (verb == 'import')
    return import_module(f'hunt_ros.cli.{name}')


def parser_of(verb: str | None) -> Parser:
    """Build the parser; only the verb that is asked for is imported in full."""
    parser = Parser(
        prog='hunt',
        description='Live monitoring of hunting motion on a railway roller rig.',
        epilog='Each verb has its own help: hunt VERB --help',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'hunt_ros {__version__}')
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for name, summary in VERBS.items():
        subparser = verbs.add_parser(name, help=summary, description=summary)
        if name == verb:
            module = module_of(verb)
            subparser.formatter_class = argparse.RawDescriptionHelpFormatter
            subparser.epilog = f'example:\n  {module.EXAMPLE}'
            module.configure(subparser)
            if verb not in _ACTING:
                subparser.add('--json')
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
    if '_ARGCOMPLETE' in os.environ:  # a shell asks what may follow: it goes no further
        import argcomplete

        told = os.environ.get('COMP_LINE', '').split()
        argcomplete.autocomplete(parser_of(told[1] if len(told) > 1 else None))
    name = f'hunt {words[0]}' if words and words[0] in VERBS else 'hunt'
    for at, usual in enumerate(('stdin', 'stdout', 'stderr')):
        if getattr(sys, usual) is None:  # closed (`>&-`): its number is that of the next file
            null = os.open(os.devnull, os.O_RDWR)
            setattr(sys, usual, os.fdopen(null, 'w' if at else 'r'))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may lack a sign of a name
            stream.reconfigure(errors='replace')
    # Where it keeps its cache when the home folder is read-only is nothing to act on.
    logging.getLogger('matplotlib').setLevel(logging.ERROR)
    try:
        parsed = parser_of(words[0] if words else None).parse_args(words)
        # Imported here, for an interrupt finds nobody who takes it before.
        say = import_module('hunt_ros.compiled').on_compilation
        say(lambda text: print(f'{name}: {text}', file=sys.stderr, flush=True))
        found: Found | int = parsed.run(parsed)
        return found if isinstance(found, int) else tell(found, parsed.json)
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
        return _ended(
            f'{name}: internal error ({one_line(error):.200}), please report it;'
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
