"""
One switch between numba's compiler and plain Python.

Inner loops are written once, in the subset of Python that numba compiles, and
decorated with `compiled`. With the extra ``fast`` installed they run as machine
code; without it they run as they stand, slower, with the same results to
rounding.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

_Function = TypeVar('_Function', bound=Callable[..., Any])

#: How long all kernels take, s (87 s of CPU on a busy machine), and how often they are heard of.
_USUAL_S, _PROGRESS_S = 80, 5.0

#: True where numba is installed and kernels run as machine code.
HAVE_COMPILER: bool = find_spec('numba') is not None


def compiled(function: _Function) -> _Function:
    """
    Compile a kernel on first use, and keep the machine code on disk.

    The kernel releases the GIL, and keeps IEEE semantics (no fastmath), so that
    NaN stays NaN and a block split in two gives the same numbers as the whole.

    Parameters
    ----------
    function : callable
        Numeric code on scalars and numpy arrays, without Python objects.

    Returns
    -------
    callable
        The compiled kernel, or `function` itself where numba is missing.

    Notes
    -----
    Where nothing can be written, neither beside the source nor in the home folder, the
    kernel is compiled anew by each process, and a line on stderr says so.
    """
    if not HAVE_COMPILER:
        return function
    try:
        kernel = _numba().njit(cache=True, nogil=True)(function)
    except RuntimeError as error:
        if 'cannot cache' not in str(error):
            raise
        _tell_uncached()
        return compiled_part(function)
    kernel._cache.load_overload = partial(_load, kernel._cache, kernel._cache.load_overload)
    return cast(_Function, kernel)


def _load(cache: Any, load: Callable[..., Any], signature: Any, target: Any) -> Any:
    """Load machine code from disk; what an earlier version left there is thrown away."""
    try:
        return load(signature, target)
    except (ImportError, AttributeError):  # it names types that are no longer where they were
        cache.flush()
        return None


def compiled_part(function: _Function) -> _Function:
    """
    Compile a function that only kernels in other modules call, and keep nothing on disk.

    What is kept on disk is checked against the file of the kernel itself, not against
    the files of what it calls: a part kept there would outlive a change of its own
    parts. The kernel keeps its parts with it, and is told of their changes by
    `source_stamp`.

    Parameters
    ----------
    function : callable
        As for `compiled`.

    Returns
    -------
    callable
        The compiled function, or `function` itself where numba is missing.
    """
    if not HAVE_COMPILER:
        return function
    return cast(_Function, _numba().njit(nogil=True)(function))


@cache
def _tell_uncached() -> None:
    """Log once that machine code finds no place on disk."""
    print(
        'hunt_ros: compiled kernels cannot be kept, neither beside their source nor in the home'
        ' folder: they are compiled at every start (NUMBA_CACHE_DIR names a place for them)',
        file=sys.stderr,
    )


def on_compilation(say: Callable[[str], None]) -> None:
    """
    Have it said when kernels are not on disk yet, and how far their compilation is.

    Parameters
    ----------
    say : callable
        Gets one line, in the thread that compiles; nothing where all is on disk.
    """
    global _say
    _say = say


_say: Callable[[str], None] = lambda text: None  # noqa: E731


@cache
def _numba() -> Any:
    """Import the compiler where a kernel needs it: it takes half a second."""
    import numba
    from numba.core import event

    class Progress(event.Listener):  # type: ignore[misc]
        """Hears each compilation; those of parts lie within those of their kernels."""

        depth = 0
        done = 0
        began = 0.0
        told = 0.0

        def on_start(self, event: Any) -> None:
            """Print that the work goes on, now and then."""
            now = time.monotonic()
            if self.began == 0.0:
                self.began = self.told = now
                _say(f'compiling kernels, once: about {_USUAL_S} s')
            elif now - self.told >= _PROGRESS_S:
                self.told = now
                _say(f'compiling kernels: {now - self.began:.0f} s, {self.done} done')
            self.depth += 1

        def on_end(self, event: Any) -> None:
            """Count a kernel when its own compilation is over."""
            self.depth -= 1
            self.done += self.depth == 0

    event.register('numba:compile', Progress())  # type: ignore[no-untyped-call]
    return numba


def source_stamp(*modules: ModuleType) -> int:
    """
    Return a number that changes when the source of one of the modules does.

    A kernel that closes over it is compiled anew then; 0 where there are no files.
    """
    stamp = 0
    for module in modules:
        try:
            stamp = max(stamp, Path(str(module.__file__)).stat().st_mtime_ns)
        except OSError:
            return 0
    return stamp
