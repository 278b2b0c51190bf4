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
    seconds = time.monotonic() - began
    print(f'{count} kernels compiled in {seconds:.0f} s' if count else 'the kernels are compiled')
    return 0
