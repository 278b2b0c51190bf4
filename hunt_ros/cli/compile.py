"""`hunt compile`: make the machine code of every kernel once, so that no first run waits."""

from __future__ import annotations

import argparse
import time

from hunt_ros.compiled import HAVE_COMPILER, compile_all, is_complete

EXAMPLE = 'hunt compile'


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare no option: there is none."""


def run(arguments: argparse.Namespace) -> int:
    """Compile what is not on disk yet."""
    if not HAVE_COMPILER:
        print('without numba the kernels run as plain Python: nothing to compile')
        return 0
    began = time.monotonic()
    count = compile_all()
    if not is_complete():
        return 1  # it has been said why
    seconds = f' ({time.monotonic() - began:.0f} s)' if count else ''
    print(f'the kernels are compiled, {count} of them now{seconds}')
    return 0
