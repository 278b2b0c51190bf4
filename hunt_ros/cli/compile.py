"""`hunt compile`: make the machine code of every kernel once, so that no first run waits."""

from __future__ import annotations

import argparse
import os
import time

from hunt_ros.cli.support import options
from hunt_ros.compiled import HAVE_COMPILER, compile_all, is_complete

EXAMPLE = 'hunt compile'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    what = 'on one core, at the lowest priority'
    options.add(parser, '--background', **options.FLAG, help=what)


def run(arguments: argparse.Namespace) -> int:
    """Compile what is not on disk yet."""
    if not HAVE_COMPILER:
        print('without numba the kernels run as plain Python: nothing to compile')
        return 0
    if arguments.background:
        os.nice(19)
    began = time.monotonic()
    count = compile_all(1 if arguments.background else None)
    if not is_complete():
        return 1  # it has been said why
    seconds = f' ({time.monotonic() - began:.0f} s)' if count else ''
    print(f'the kernels are compiled, {count} of them now{seconds}')
    return 0
